"""Does an answer agree with what is known of the mount, and which of its directions
rest on that?

Some mistakes show in no residual: poses of a tool in place of the flange move the
sensor as if it were mounted elsewhere, and profiles whose z is negated are those of a
scanner turned by 180°. Beside a mount that is known roughly they show.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc

from profilecal.calibration.evidence import evidence
from profilecal.geometry.noise import FALSE_ALARM, normalised_square
from profilecal.geometry.observability import (
    HAND_PRECISION,
    name_direction,
    size_direction,
)
from profilecal.geometry.poses import homogeneous, inverse, pose_error
from profilecal.joint.prior import Mount
from profilecal.joint.solution import Solution

# By what the profiles' x and z may be: half a turn of the sensor that looks the same;
# y, which no profile shows, turns along.
MISTAKEN = {
    "": np.eye(3),
    "z of the profiles were negated": np.diag([1.0, -1, -1]),
    "x of the profiles were negated": np.diag([-1.0, -1, 1]),
    "x and z of the profiles were negated": np.diag([-1.0, 1, -1]),
    "x and z of the profiles were exchanged": np.diag([1.0, -1, 1])[::-1],
}
ORIGIN_MM = 300.0  # makers let z begin at the housing, or in the middle of the range


@dataclass(frozen=True)
class Shown:
    """What the residuals alone say of the sensor pose near a solution."""

    directions: ndarray  # (6, 6) rows, in units of the measurement by hand
    information: ndarray  # (6,) along them
    offset: ndarray  # (6,) from the solution, along them

    def chance(self, delta: ndarray, covariance: ndarray) -> float:
        """That more than δ (6,), mm and rad, of this covariance lies between the
        solution and a mount, in the directions that are determined.
        """
        known = self.information > 1
        D = self.directions[known] / HAND_PRECISION
        C = D @ covariance @ D.T + np.diag(1 / self.information[known])
        error = D @ delta - self.offset[known]
        chance = chdtrc(len(error), normalised_square(C, error))
        return float(chance) if len(error) else 1.0


def shown_by(solution: Solution) -> Shown:
    """What the residuals alone say near a solution; all else is integrated out."""
    model, posterior = solution.model()
    normal = posterior.normal[0] - model.of_mount
    says = evidence(normal, model.precision[6:, 6:], slice(6))
    by_hand = says.along(np.diag(HAND_PRECISION))
    values, vectors = np.linalg.eigh(by_hand.information)
    values = np.maximum(values, np.finfo(float).eps * values[-1])
    return Shown(vectors.T, values, -(vectors.T @ by_hand.slope) / values)


def contradiction(solution: Solution, mount: Mount) -> str:
    """A sentence on how a solution contradicts what is known of the mount, and on what
    would explain it; none where it does not.
    """
    R, T = solution.rotation, solution.translation
    shown, along_z = shown_by(solution), np.diag([0, 0, ORIGIN_MM**2, 0, 0, 0])
    C = np.diag(mount.sd**2) + solution.covariance_total - solution.covariance
    causes = []
    for words, turn in MISTAKEN.items():
        delta = pose_error(R, T, mount.rotation @ turn, mount.translation)
        if shown.chance(delta, C) > FALSE_ALARM:
            if not words:
                return ""
            causes.append(words)
        elif shown.chance(delta, C + along_z) > FALSE_ALARM:
            from_elsewhere = f"z of the profiles were about {delta[2]:+.0f} mm off"
            causes.append(f"{words} and {from_elsewhere}" if words else from_elsewhere)
    delta = pose_error(R, T, *inverse(mount.rotation, mount.translation))
    if shown.chance(delta, C) > FALSE_ALARM:
        causes.append("the guess were of the flange in the sensor's frame")
    tool = homogeneous(mount.rotation, mount.translation) @ np.linalg.inv(solution.pose)
    x, y, z = tool[:3, 3]
    w, p, r = Rotation.from_matrix(tool[:3, :3]).as_euler("xyz", degrees=True)
    causes.append(
        "the poses were of a tool whose frame is at about "
        f"{x:.0f}, {y:.0f}, {z:.0f} mm and {w:.0f}, {p:.0f}, {r:.0f}° on the flange"
    )
    delta = pose_error(R, T, mount.rotation, mount.translation)
    shift, turn = np.linalg.norm(delta.reshape(2, 3), axis=1)
    return (
        f"the answer lies {shift:.3g} mm and {np.degrees(turn):.3g}° from the guess, "
        f"which is said to be good to {mount.sd[0]:.3g} mm and "
        f"{np.degrees(mount.sd[3]):.3g}°; it looks as if {', or as if '.join(causes)}; "
        "no residual can tell"
    )


def rests_on(solution: Solution, mount: Mount) -> list[str]:
    """Sentences on the directions of which the mount says more than the scan."""
    shown, sentences = shown_by(solution), []
    to_hand = solution.problem.observations[0].eye_to_hand
    frame = "base" if to_hand else "flange"
    by_mount = shown.directions**2 @ (HAND_PRECISION / mount.sd) ** 2
    for direction in shown.directions[by_mount > shown.information]:
        along = direction / HAND_PRECISION
        sd = float(np.sqrt(along @ solution.covariance @ along))
        sentences.append(
            f"{name_direction(direction, solution.rotation, frame)} rests on the "
            f"guess more than on the scan: {size_direction(sd, direction)}"
        )
    return sentences
