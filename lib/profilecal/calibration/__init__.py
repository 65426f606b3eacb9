"""From a user's scans to an answer that can be believed or a reason why there is none.

In: `Scan`s. Out: a `Calibration`: the joint solution, what its residuals say against it
(`plausibility`), or what the poses may mean instead (`other_conventions`).
`self_test`: whether its uncertainty can be believed; `verify`: whether a second scan
agrees; `check_mount`: whether anything has moved.
"""
