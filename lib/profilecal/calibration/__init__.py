"""From a user's scans to an answer that can be believed or a reason why there is none.

In: `Scan`s. Out: a `Calibration`: the joint solution, what its residuals say against it
(`plausibility`), or what the poses may mean instead (`other_conventions`). `check` (in
`observe`): what a scan holds before any calibration; `leave_out`: how well the others
predict each orientation; `verify`: whether a second scan agrees.
"""
