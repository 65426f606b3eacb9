"""Which poses, and how many: what they will be worth, before anything is measured.

In: a `ScanModel`, what is known beforehand of scanner, robot and target, and where the
robot may go. Out: a `Prediction`, the covariance that `calibrate` will state; a `Plan`,
poses that make it small; a folder ready to run.

Each pose adds a block of information, its own robot error integrated out. Blocks of
poses with different orientations add up, so a plan is a choice of blocks: a greedy
start, then exchanges, one pose at a time.

In reading order: `specification` says what is guessed and asked for, `scan_model`
predicts, `candidates` draws poses that are possible, `design` chooses among them,
`sweeps` goes along lines through them; `knowledge` makes models of specifications and
scans, `words` says what is predicted, and `task` is what a user asks for.
"""
