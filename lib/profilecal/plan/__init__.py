"""Which poses, and how many: what a plan will be worth, and which plan is worth most, before anything is measured.

In: a `Setup`, what is known beforehand of scanner, robot and target; poses, or limits for them. Out: a `Prediction`,
the covariance that `calibrate` will state for such poses; a `Plan`, poses that make it small; a folder ready to run,
with a page to look at.

Each pose adds a block of information, its own robot error integrated out. Blocks of poses with different orientations
add up, so a plan is a choice of blocks: a greedy start, then exchanges, one pose at a time.
"""
