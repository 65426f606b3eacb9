"""A robot's accuracy over its workspace: errors that near poses share, and an error that all poses share.

A robot whose joints have other zeros and whose links have other lengths than its controller believes errs smoothly over
the workspace. Most of that is a shift and turn of its base, which the target's place absorbs. What is left has two
parts, whose sizes go together: a field that differs between orientations 45° and places 300 mm apart, which shows in
the residuals; and an error of the flange that is the same at all poses, which does not, and which goes into the answer.
Their ratio and the field's lengths differ from arm to arm; those below are cautious for the arm of notebook 43.
"""

from dataclasses import dataclass, replace

import numpy as np

from profilecal.geometry.noise import variances
from profilecal.geometry.poses import angle_between, inverse
from profilecal.joint.effects import Information
from profilecal.joint.sharing import Sharing

ANGLE_DEG, DISTANCE_MM = 45.0, 300.0  # of a squared exponential: poses that far apart err differently
FIELD_SHARE = 1 / 4, 1 / 2  # of the accuracy in position and in orientation: the field's; the common error's is 1
LEAST_SHARE = 1e-3  # of the field's largest pattern: a smaller one is left out


@dataclass(frozen=True)
class Field:
    """The patterns of the robot's accuracy at the orientations of some poses."""

    patterns: np.ndarray  # (orientations, r)
    to_base: np.ndarray  # (orientations, 6, 6) from the sensor's axes to those in which the field is smooth
    lever: np.ndarray  # (3,) mm, from the flange to the sensor, sensor frame

    def remove(self, information: Information, accuracy_mm, accuracy_deg) -> Information:
        """What is left once a field of that accuracy, (S,) each, is integrated out."""
        shares = zip(FIELD_SHARE, (accuracy_mm, accuracy_deg), strict=True)
        size = np.sqrt(variances(*(share * np.asarray(accuracy) for share, accuracy in shares)))[:, None, :, None]
        A = size * (self.to_base @ information.of_errors @ np.swapaxes(self.to_base, 1, 2)) * np.swapaxes(size, 2, 3)
        B = size * (self.to_base @ information.crossed)
        # of coefficients (r, 6) of the patterns: Σ over orientations o of Φ_oi Φ_oj A_o, and of Φ_oi B_o
        S, G, _, n = B.shape
        r = self.patterns.shape[1]
        products = (self.patterns[:, :, None] * self.patterns[:, None]).reshape(G, r * r)
        A = (products.T @ A.reshape(S, G, 36)).reshape(S, r, r, 6, 6).swapaxes(2, 3).reshape(S, 6 * r, 6 * r)
        B = (self.patterns.T @ B.reshape(S, G, 6 * n)).reshape(S, 6 * r, n)
        inflated = np.eye(6 * r) + A
        normal = information.normal - np.swapaxes(B, 1, 2) @ np.linalg.solve(inflated, B)
        log_determinant = information.log_determinant + np.linalg.slogdet(inflated)[1]
        return replace(information, normal=normal, log_determinant=log_determinant)

    def common(self, accuracy_mm, accuracy_deg) -> np.ndarray:
        """Covariances (S, 6, 6) of δ, mm and rad, by an error of the flange that is the same at all poses."""
        lever = np.eye(6)
        lever[:3, 3:] = np.cross(np.eye(3), self.lever).T
        return lever @ (variances(accuracy_mm, accuracy_deg)[..., None] * lever.T)


def field_over(shared: Sharing, R_sensor, T_sensor, eye_to_hand: bool) -> Field:
    """The field at the orientations of some poses, for a sensor at R_sensor (3, 3), T_sensor (3,), mm."""
    _, first = np.unique(shared.orientation, return_index=True)
    R, T = shared.rotation[first], shared.translation[first]
    to_base, lever = R @ R_sensor, R_sensor.T @ T_sensor
    if eye_to_hand:  # the sensor stands in the base; poses are of the base in the flange's frame
        R, T = inverse(R, T)
        to_base, lever = np.broadcast_to(np.eye(3), R.shape), np.zeros(3)
    apart = np.degrees(angle_between(R[:, None], R)) / ANGLE_DEG
    far = np.linalg.norm(T[:, None] - T, axis=-1) / DISTANCE_MM
    values, vectors = np.linalg.eigh(np.exp(-(apart**2 + far**2) / 2))
    large = values > LEAST_SHARE * values[-1]
    both = np.zeros((len(R), 6, 6))
    both[:, :3, :3] = both[:, 3:, 3:] = to_base
    return Field(vectors[:, large] * np.sqrt(values[large]), both, lever)
