"""What a robot does beyond the errors that a scan's [noise] states: it drifts, and its arm is built
differently than its controller believes."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import rotations

AXES = np.eye(3)[[2, 1, 1, 2, 1, 2]]  # of the joints, all turned to zero: the arm then points straight up
MIDDLE = np.array([900.0, 0.0, 600.0])  # mm from its foot, where it works best
LINKS = np.array([[150, 0, 486.5], [0, 0, 700], [0, 0, 600], [0, 0, 0], [0, 0, 0], [0, 0, 65]])  # mm: reach 1.45 m


@dataclass(frozen=True)
class Arm:
    """Joints one above the other when all are at zero, the flange's z on top; a link leads from each to the next."""

    links: np.ndarray = field(default_factory=LINKS.copy)  # (6, 3) mm, the last from the wrist to the flange
    zeros: np.ndarray = field(default_factory=lambda: np.zeros(6))  # rad, where the joints are when they report zero

    @classmethod
    def erring(cls, joint_deg: float, link_mm: float, rng: np.random.Generator) -> "Arm":
        """One whose joints have other zeros and whose links end elsewhere, by these standard deviations of each joint
        and of each link's x, y and z."""
        return cls(LINKS + link_mm * rng.normal(size=(6, 3)), np.radians(joint_deg) * rng.normal(size=6))

    def flange(self, joints) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (..., 3, 3) and positions (..., 3), mm, of the flange at joint angles (..., 6), rad."""
        R, T = np.eye(3), np.zeros(3)
        turned = rotations((joints + self.zeros)[..., None] * AXES)
        for joint, link in enumerate(self.links):
            R = R @ turned[..., joint, :, :]
            T = T + R @ link
        return R, T


def joints_at(rotation, position) -> np.ndarray:
    """The angles (..., 6), rad, at which an arm without errors has its flange there, (..., 3, 3), (..., 3) mm: its
    elbow above, its fifth joint bent forwards.

    Raises ValueError for a place out of reach.
    """
    (aside, _, up), upper, fore, hand = LINKS[0], LINKS[1, 2], LINKS[2, 2], LINKS[5, 2]
    wrist = position - hand * rotation[..., 2]
    out = np.hypot(wrist[..., 0], wrist[..., 1]) - aside
    high = wrist[..., 2] - up
    bend = (out**2 + high**2 - upper**2 - fore**2) / (2 * upper * fore)  # cosine of the elbow's angle
    if (np.abs(bend) > 1).any():
        farthest = np.sqrt(out**2 + high**2).max()
        raise ValueError(
            f"the arm's wrist is up to {farthest:.0f} mm from its shoulder; "
            f"expected {upper - fore:.0f} to {upper + fore:.0f} mm at all poses"
        )
    elbow = np.arccos(bend)
    shoulder = np.arctan2(out, high) - np.arctan2(fore * np.sin(elbow), upper + fore * np.cos(elbow))
    first = np.stack([np.arctan2(wrist[..., 1], wrist[..., 0]), shoulder + elbow], axis=-1)
    forearm = Rotation.from_euler("ZY", first).as_matrix()
    last = Rotation.from_matrix(forearm.mT @ rotation).as_euler("ZYZ")
    return np.concatenate([first[..., :1], np.stack([shoulder, elbow], axis=-1), last], axis=-1)


def where_it_is(arm: Arm, rotation, position) -> tuple[np.ndarray, np.ndarray]:
    """Where an arm really has its flange when it reports poses (P, 3, 3), (P, 3), mm.

    It stands upright where the middle of the positions is before it: the poses are reported in a frame of the user's.
    """
    foot = position.mean(axis=0) - MIDDLE
    R, T = arm.flange(joints_at(rotation, position - foot))
    return R, T + foot


@dataclass(frozen=True)
class Robot:
    """Standard deviations of a robot's errors; the entries that a specification's [robot] table has."""

    joint_deg: float = 0.0  # of each joint's zero, for good
    link_mm: float = 0.0  # of the x, y and z of each link, for good
    drift_mm: float = 0.0  # along each axis, from the first pose to the last

    def built(self, rotation, position, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Where an arm built like this has its flange when it reports poses (P, 3, 3), (P, 3), mm. Raises ValueError
        for poses out of reach."""
        if not (self.joint_deg or self.link_mm):
            return rotation, position
        return where_it_is(Arm.erring(self.joint_deg, self.link_mm, rng), rotation, position)

    def visiting(self, rotation, position, noise: Noise, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Where the flange is when the robot goes through poses (P, 3, 3), (P, 3), mm, once and in this order."""
        if self.drift_mm:
            position = position + np.linspace(0, self.drift_mm, len(position))[:, None] * rng.normal(size=3)
        if noise.repeatability_mm:
            position = position + noise.repeatability_mm * rng.normal(size=position.shape)
        if noise.repeatability_deg:
            rotation = rotations(np.radians(noise.repeatability_deg) * rng.normal(size=position.shape)) @ rotation
        return rotation, position
