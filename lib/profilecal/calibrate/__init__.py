"""From a user's scans to an answer that can be believed or a reason why there is none.

In: `Scan`s, as `scan.folder.read_scan` gives them. Out: a `Calibration`: the joint solution, what its residuals say
against it (`plausibility`), or what the poses may mean instead (`other_conventions`). `summary` says it in words.
`check`: what a scan holds before any calibration; `leave_out`: how well each orientation is predicted by the others;
`verify`: whether a second scan agrees.
"""
