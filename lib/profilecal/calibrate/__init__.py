"""From a user's scans to an answer that can be believed or a reason why there is none.

In: `Scan`s, as `scan.folder.read_scan` gives them. Out: a `Calibration`, the joint solution with what its residuals say
against it, in words for people and as JSON for programs; another reading of the poses that explains a scan which
contradicts itself (`readings`); what a scan holds before any calibration (`check`); how well each orientation is
predicted by the others (`leave_out`); whether the answer of a second scan agrees (`verify`).
"""
