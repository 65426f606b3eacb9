"""One calibration for every target: the sensor pose and where each target is, in one
maximum-likelihood step.

In: `Observations`, what the scanner saw of each target and the flange poses that the
robot reports, and a `Noise`. Out: a `Solution`, the sensor pose with its covariance and
what speaks for and against it.

A residual is an observed point minus where the scan plane meets the target, in the scan
plane. A target says how it changes with the target's own frame (`targets.target`);
everything else is the same for all of them and stands here. The sensor pose is
perturbed as T · exp(δ), δ = (ρ, φ) in the sensor's frame: a point at p there moves to
p - ρ + p × φ.

The first axis of arrays in `residuals`, `problem` and `descent` is a batch: of states
of one problem, or of as many problems, each with observations of its own. The "first
problem" is the first of such a batch. `linear_model`, and the files that rest on it,
take a state of a batch of one; the first axis of their arrays is over sets of
variances.

In reading order: `problem` arranges the residuals of all targets (`residuals`), and
what may be wrong with them (`prior`); `descent` finds the least squares, `delay` finds
at which delay of the clocks, and `first_fit` a fit to most of the poses. At a state all
else is one linear Gaussian model (`linear_model`): errors of the robot that profiles
share (`pose_groups`, `nesting`, `nested_errors`) or that vary smoothly with the pose
(`smooth`), and errors of scanner and target that are the same at every pose. How large
all errors are (`error_sizes`, by the `restricted_likelihood`), and which profiles
belong to the others (`rejection`), is found in rounds. A `solution` follows from the
last round (`conclusion`). `solve` calls all of these.
"""
