"""Does an answer agree with what is known of the mount, and which of its directions
rest on that?

Some mistakes show in no residual: poses of a tool in place of the flange move the
sensor as if it were mounted elsewhere, and profiles whose z is negated are those of a
scanner turned by 180°. Beside a mount that is known roughly they show.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc

from profilecal.geometry.noise import FALSE_ALARM, normalised_square
from profilecal.geometry.observability import (
    HAND_PRECISION,
    Spectrum,
    name_direction,
    of_covariance,
    size_direction,
)
from profilecal.geometry.poses import homogeneous, inverse, pose_error
from profilecal.joint.prior import Mount
from profilecal.joint.solution import Solution

# By what the profiles' x and z may be: half a turn of the sensor that looks the same;
# y, which no profile shows, turns along.
MISTAKEN = {
    "z of the profiles were about {:+.0f} mm off": np.eye(3),
    "z of the profiles were negated": np.diag([1.0, -1, -1]),
    "x of the profiles were negated": np.diag([-1.0, -1, 1]),
    "x and z of the profiles were negated": np.diag([-1.0, 1, -1]),
    "x and z of the profiles were exchanged": np.diag([1.0, -1, 1])[::-1],
}
# poses, by the frame that they should be of, or in
NOT_IN = {"flange": "of a tool", "base": "in a user frame"}
ORIGIN_MM = 300.0  # makers let z begin at the housing, or in the middle of the range
NOTHING = 1e4  # mm or rad: as much as nothing is known


def shown_by(solution: Solution) -> tuple[ndarray, Spectrum]:
    """δ (6,), mm and rad, from a solution to what the residuals alone say, and how well
    they tell it.
    """
    model = replace(solution.model(), of_mount=0.0)
    posterior = model.posterior(solution.error_sizes.median_v[None])
    covariance = posterior.covariance[0, :6, :6]
    return posterior.mean[0, :6], of_covariance(covariance)


def disagreement(solution: Solution, mount: Mount | None) -> list[str]:
    """A sentence on how a solution contradicts what is known of the mount, and on what
    would explain it; none where chance does.

    Compared are the directions D that the residuals tell better than one would by hand.
    C is the doubt of both: what residuals leave, what none shows, and the mount's own.
    """
    if mount is None:
        return []
    R, T = mount.rotation, mount.translation
    offset, shown = shown_by(solution)
    D = shown.directions[shown.sd < 1] / HAND_PRECISION
    beside = solution.covariance_total - solution.covariance
    C = shown.covariance + beside + np.diag(np.minimum(mount.sd, NOTHING) ** 2)

    def off(R_other: ndarray, T_other: ndarray) -> ndarray:
        """How far the solution is from a mount."""
        return pose_error(solution.rotation, solution.translation, R_other, T_other)

    def agrees(R_other: ndarray, T_other: ndarray, z_mm: float = 0.0) -> bool:
        """Whether chance explains how far a mount, of such a doubt along z, is from
        what the residuals say, in the directions that these determine.
        """
        doubt = D @ (C + np.diag([0, 0, z_mm**2, 0, 0, 0])) @ D.T
        square = normalised_square(doubt, D @ (off(R_other, T_other) - offset))
        return not chdtrc(len(D), square) < FALSE_ALARM  # NaN where there are none

    if agrees(R, T):
        return []
    shift, turn = off(R, T).reshape(2, 3)
    causes = [
        words.format(shift[2])
        for words, turned in MISTAKEN.items()
        if agrees(R @ turned, T, ORIGIN_MM)
    ]
    if agrees(*inverse(R, T)):
        causes.append(
            f"the guess were of the {solution.problem.frame} in the sensor's frame"
        )
    causes.append(other_frame(solution, homogeneous(R, T)))
    said = (mount.sd[0], " mm"), (np.degrees(mount.sd[3]), "°")
    good = " and ".join(f"{sd:.3g}{unit}" for sd, unit in said if np.isfinite(sd))
    return [
        f"the answer lies {np.linalg.norm(shift):.3g} mm and "
        f"{np.degrees(np.linalg.norm(turn)):.3g}° from the guess, "
        f"which is said to be good to {good}; "
        f"it looks as if {', or as if '.join(causes)}; no residual can tell"
    ]


def other_frame(solution: Solution, guess: ndarray) -> str:
    """Words on the frame in place of the flange, or of the base, that explains any
    difference from a guess (4, 4).
    """
    frame = solution.problem.frame
    tool = guess @ np.linalg.inv(solution.pose)
    x, y, z = tool[:3, 3]
    w, p, r = Rotation.from_matrix(tool[:3, :3]).as_euler("xyz", degrees=True)
    return (
        f"the poses were {NOT_IN[frame]} whose axes are at about "
        f"{x:.0f}, {y:.0f}, {z:.0f} mm and {w:.0f}, {p:.0f}, {r:.0f}° in the {frame}'s"
    )


def rests_on(solution: Solution, mount: Mount) -> Iterator[str]:
    """Sentences on the directions of which the mount says more than the scan."""
    _, shown = shown_by(solution)
    frame = solution.problem.frame
    by_mount = shown.directions**2 @ (HAND_PRECISION / mount.sd) ** 2
    for direction in shown.directions[by_mount * shown.sd**2 > 1]:
        along = direction / HAND_PRECISION
        sd = float(np.sqrt(along @ solution.covariance @ along))
        yield (
            f"{name_direction(direction, solution.rotation, frame)} rests on the "
            f"guess more than on the scan: {size_direction(sd, direction)}"
        )
