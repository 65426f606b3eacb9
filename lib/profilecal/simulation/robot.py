"""What a robot and a scanner do. The robot errs at each pose that it reports, it
drifts, and its arm is built otherwise than its controller believes; the scanner reports
the outline that its scan plane cuts from a scene.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise
from profilecal.geometry.poses import carry, inverse, rotations


@dataclass(frozen=True)
class Poses:
    """G rotation groups of N positions: what the robot reports, base frame, mm."""

    rotations: np.ndarray  # (..., G, 3, 3) of the flange
    positions: np.ndarray  # (..., G, N, 3) of the flange

    def first(self, groups: int) -> "Poses":
        """The first groups only, in the order they were collected."""
        return Poses(
            self.rotations[..., :groups, :, :], self.positions[..., :groups, :, :]
        )

    def carry(self, points, R_sensor, T_sensor) -> np.ndarray:
        """Sensed points (..., G, N, M, 2), mm, in the base frame, (..., G, N, M, 3), by
        the poses reported and the sensor's pose R_sensor (..., 3, 3), T_sensor (...,
        3), mm, on the flange.
        """
        R = (self.rotations @ R_sensor[..., None, :, :])[..., None, :, :]
        T = carry(
            self.rotations[..., None, :, :],
            self.positions,
            T_sensor[..., None, None, :],
        )
        return points @ R[..., ::2].mT + T[..., None, :]


def actual_poses(
    poses: Poses,
    noise: Noise,
    rng: np.random.Generator,
    same=slice(None),
    to_hand: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Where the flange really is, rotations (..., G, N, 3, 3) and positions (..., G, N,
    3), mm. `same` (G,): groups with one number share a group's error. `to_hand`: poses
    are of the base in the flange's frame; the result is not.
    """
    shape = poses.positions.shape
    group = (*shape[:-2], 1, 3)

    def error(own, shared):
        return (
            own * rng.normal(size=shape)
            + shared * rng.normal(size=group)[..., same, :, :]
        )

    position = error(noise.position_mm, noise.group_position_mm)
    turn = error(noise.orientation_deg, noise.group_orientation_deg)
    R, T = poses.rotations[..., None, :, :], poses.positions
    if to_hand:
        R, T = inverse(R, T)
    return rotations(np.radians(turn)) @ R, T + position


def scan_planes(
    R_sensor, T_sensor, rotations, positions
) -> tuple[np.ndarray, np.ndarray]:
    """Orientations (..., G, N, 3, 3) and origins (..., G, N, 3), mm, of scan planes in
    the base frame, from the flange's `rotations` and `positions`, of the same shapes.
    """
    return rotations @ R_sensor[..., None, None, :, :], carry(
        rotations, positions, T_sensor[..., None, None, :]
    )


# of the joints, all turned to zero: the arm then points straight up
AXES = np.eye(3)[[2, 1, 1, 2, 1, 2]]
MIDDLE = np.array([900.0, 0.0, 600.0])  # mm from its foot, where it works best
LINKS = np.array(
    [[150, 0, 486.5], [0, 0, 700], [0, 0, 600], [0, 0, 0], [0, 0, 0], [0, 0, 65]]
)  # mm: reach 1.45 m


@dataclass(frozen=True)
class Arm:
    """Joints one above the other when all are at zero, the flange's z on top; a link
    leads from each to the next.
    """

    # (6, 3) mm, the last from the wrist to the flange
    links: np.ndarray = field(default_factory=LINKS.copy)
    # rad, where the joints are when they report zero
    zeros: np.ndarray = field(default_factory=lambda: np.zeros(6))

    @classmethod
    def erring(
        cls, joint_deg: float, link_mm: float, rng: np.random.Generator
    ) -> "Arm":
        """One whose joints have other zeros and whose links end elsewhere, by these
        standard deviations of each joint and of each link's x, y and z.
        """
        return cls(
            LINKS + link_mm * rng.normal(size=(6, 3)),
            np.radians(joint_deg) * rng.normal(size=6),
        )

    def flange(self, joints) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (..., 3, 3) and positions (..., 3), mm, of the flange at joint
        angles (..., 6), rad.
        """
        R, T = np.eye(3), np.zeros(3)
        turned = rotations((joints + self.zeros)[..., None] * AXES)
        for joint, link in enumerate(self.links):
            R = R @ turned[..., joint, :, :]
            T = T + R @ link
        return R, T


def joints_at(rotation, position) -> np.ndarray:
    """The angles (..., 6), rad, at which an arm without errors has its flange there,
    (..., 3, 3), (..., 3) mm: its elbow above, its fifth joint bent forwards. Raises
    ValueError for a place out of reach.
    """
    (aside, _, up), upper, fore, hand = LINKS[0], LINKS[1, 2], LINKS[2, 2], LINKS[5, 2]
    wrist = position - hand * rotation[..., 2]
    out = np.hypot(wrist[..., 0], wrist[..., 1]) - aside
    high = wrist[..., 2] - up
    # cosine of the elbow's angle
    bend = (out**2 + high**2 - upper**2 - fore**2) / (2 * upper * fore)
    if (np.abs(bend) > 1).any():
        farthest = np.sqrt(out**2 + high**2).max()
        raise ValueError(
            f"the arm's wrist is up to {farthest:.0f} mm from its shoulder; "
            f"expected {upper - fore:.0f} to {upper + fore:.0f} mm at all poses"
        )
    elbow = np.arccos(bend)
    shoulder = np.arctan2(out, high) - np.arctan2(
        fore * np.sin(elbow), upper + fore * np.cos(elbow)
    )
    first = np.stack(
        [np.arctan2(wrist[..., 1], wrist[..., 0]), shoulder + elbow], axis=-1
    )
    forearm = Rotation.from_euler("ZY", first).as_matrix()
    last = Rotation.from_matrix(forearm.mT @ rotation).as_euler("ZYZ")
    return np.concatenate(
        [first[..., :1], np.stack([shoulder, elbow], axis=-1), last], axis=-1
    )


def where_it_is(arm: Arm, rotation, position) -> tuple[np.ndarray, np.ndarray]:
    """Where an arm really has its flange when it reports poses (P, 3, 3), (P, 3), mm,
    in a frame of the user's: it stands upright where the middle of the positions is
    before it.
    """
    foot = position.mean(axis=0) - MIDDLE
    R, T = arm.flange(joints_at(rotation, position - foot))
    return R, T + foot


@dataclass(frozen=True)
class Robot:
    """Standard deviations of a robot's errors; the entries that a specification's
    [robot] table has.
    """

    joint_deg: float = 0.0  # of each joint's zero, for good
    link_mm: float = 0.0  # of the x, y and z of each link, for good
    drift_mm: float = 0.0  # along each axis, from the first pose to the last

    def built(
        self, rotation, position, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where an arm built like this has its flange when it reports poses (P, 3, 3),
        (P, 3), mm. Raises ValueError for poses out of reach.
        """
        if not (self.joint_deg or self.link_mm):
            return rotation, position
        return where_it_is(
            Arm.erring(self.joint_deg, self.link_mm, rng), rotation, position
        )

    def visiting(
        self, rotation, position, noise: Noise, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where the flange is when the robot goes through poses (P, 3, 3), (P, 3), mm,
        once and in this order.
        """
        if self.drift_mm:
            position = position + np.linspace(0, self.drift_mm, len(position))[
                :, None
            ] * rng.normal(size=3)
        if noise.repeatability_mm:
            position = position + noise.repeatability_mm * rng.normal(
                size=position.shape
            )
        if noise.repeatability_deg:
            rotation = (
                rotations(
                    np.radians(noise.repeatability_deg)
                    * rng.normal(size=position.shape)
                )
                @ rotation
            )
        return rotation, position


@dataclass(frozen=True)
class Scanner:
    """A laser triangulation scanner, by default the edge paper's VLM350 (its Section
    3). Its rays fan out from behind the housing, evenly spaced at every depth.
    """

    near: float = 60.0  # mm, the measuring range in z
    far: float = 350.0  # mm
    near_width: float = 40.0  # mm, the field of view in x at `near`
    far_width: float = 160.0  # mm, at `far`
    points: int = 980  # of a profile
    # mm in x: a sample comes from anywhere within this width around its ray
    resolution: float = 0.25
    quantum: float = 0.1  # mm, coordinates are whole multiples of it
    # standard deviation of z: of a resolution of 0.2 mm, as a uniform error's width
    noise_mm: float = 0.06

    def half_width(self, z) -> np.ndarray:
        """Half the field of view in x at depth z, mm."""
        return (
            self.near_width
            + (self.far_width - self.near_width)
            * (z - self.near)
            / (self.far - self.near)
        ) / 2

    def profile(self, outline, rng: np.random.Generator) -> np.ndarray:
        """Profiles (..., points, 2) as the scanner sends them, mm, NaN where nothing
        is, of chains (..., V, 2) of straight pieces in the scan plane, x and z in mm.
        """
        rays = np.linspace(-1, 1, self.points)
        middle = self.half_width(outline[..., 1].mean(axis=-1))[..., None]
        spot = (
            rng.uniform(-0.5, 0.5, (*middle.shape[:-1], self.points))
            * self.resolution
            / middle
        )
        z = nearest_on_rays(outline, rays + spot, self)
        z = z + self.noise_mm * rng.normal(size=z.shape)
        x = rays * self.half_width(z)
        seen = (self.near <= z) & (z <= self.far)  # false for NaN: nothing there
        return np.where(
            seen[..., None],
            np.rint(np.stack([x, z], axis=-1) / self.quantum) * self.quantum,
            np.nan,
        )


def nearest_on_rays(outline, rays, scanner: Scanner) -> np.ndarray:
    """Depth z (..., n) at which rays (..., n), as fractions of the half width, first
    meet an outline (..., V, 2), or NaN: a ray meets a straight piece with ends to
    either side of it, where the distance in x is zero.
    """
    x, z = np.moveaxis(outline, -1, 0)  # (..., V)
    half, depth = scanner.half_width(z), np.full(rays.shape, np.nan)
    right = x[..., None] > half[..., None] * rays[..., None, :]
    # of all pairs, few
    *scan, piece, ray = np.nonzero(right[..., :-1, :] != right[..., 1:, :])
    begin, stop, ray = (*scan, piece), (*scan, piece + 1), (*scan, ray)
    start, end = (x[at] - half[at] * rays[ray] for at in (begin, stop))
    np.fmin.at(depth, ray, z[begin] + start / (start - end) * (z[stop] - z[begin]))
    return depth
