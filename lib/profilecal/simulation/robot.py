"""What a robot and a scanner do.

The robot errs at each pose that it reports, it drifts, and its arm is built otherwise
than its controller believes. The scanner reports the outline that its scan plane cuts
from a scene.
"""

from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
from numpy import ndarray
from numpy.random import Generator
from scipy.spatial.transform import Rotation

from profilecal.geometry.noise import Noise, Sd
from profilecal.geometry.poses import Frames, inverse, rotations
from profilecal.scan.toml import Count, number

# of the joints, all turned to zero: the arm then points straight up
AXES = np.eye(3)[[2, 1, 1, 2, 1, 2]]
MIDDLE = np.array([900.0, 0.0, 600.0])  # mm from its foot, where it works best
# mm, from each joint to the next: a reach of 1.45 m
LINKS = np.array(
    [[150, 0, 486.5], [0, 0, 700], [0, 0, 600], [0, 0, 0], [0, 0, 0], [0, 0, 65]]
)


def actual_poses(
    R: ndarray,
    T: ndarray,
    noise: Noise,
    rng: Generator,
    same: ndarray | slice = slice(None),
    to_hand: bool = False,
) -> Frames:
    """Where the flange really is when the robot reports G rotation groups (..., G, 3,
    3) of N positions (..., G, N, 3), mm: (..., G, N, 3, 3) and (..., G, N, 3).

    Groups with the same number in `same` (G,) share a group's error. `to_hand`: the
    poses are of the base in the flange's frame; the result is not. The errors of each
    visit are `revisited`'s.
    """
    groups = *T.shape[:-2], 1, 3

    def error(own: float, shared: float) -> ndarray:
        """Of standard deviations `own` at each pose and `shared` by each group."""
        of_pose, of_group = rng.normal(size=T.shape), rng.normal(size=groups)
        return own * of_pose + shared * of_group[..., same, :, :]

    R = R[..., None, :, :]
    if to_hand:
        R, T = inverse(R, T)
    shift = error(noise.position_mm, noise.group_position_mm)
    turn_deg = error(noise.orientation_deg, noise.group_orientation_deg)
    return rotations(np.radians(turn_deg)) @ R, T + shift


def revisited(R: ndarray, T: ndarray, noise: Noise, rng: Generator) -> Frames:
    """The same poses (n, 3, 3), (n, 3), mm, with the errors that are fresh whenever the
    robot comes to one.
    """
    if noise.repeatability_mm:
        T = T + noise.repeatability_mm * rng.normal(size=T.shape)
    if noise.repeatability_deg:
        turn_deg = noise.repeatability_deg * rng.normal(size=T.shape)
        R = rotations(np.radians(turn_deg)) @ R
    return R, T


@dataclass(frozen=True)
class Arm:
    """An arm of six joints, which stand one above the other when all are at zero, the
    flange's z on top; a link leads from each to the next.
    """

    # (6, 3) mm, the last from the wrist to the flange
    links: ndarray = field(default_factory=LINKS.copy)
    # rad, where the joints are when they report zero
    zeros: ndarray = field(default_factory=lambda: np.zeros(6))

    @classmethod
    def erring(cls, joint_deg: float, link_mm: float, rng: Generator) -> "Arm":
        """One whose joints have other zeros and whose links end elsewhere, by these
        standard deviations of each joint and of each link's x, y and z.
        """
        links = LINKS + link_mm * rng.normal(size=LINKS.shape)
        return cls(links, np.radians(joint_deg) * rng.normal(size=6))

    def flange(self, joints: ndarray) -> Frames:
        """Rotations (..., 3, 3) and positions (..., 3), mm, of the flange at joint
        angles (..., 6), rad.
        """
        R, p = np.eye(3), np.zeros(3)
        vectors = (joints + self.zeros)[..., None] * AXES
        for k, link in enumerate(self.links):
            R = R @ rotations(vectors[..., k, :])
            p = p + R @ link
        return R, p


def joints_at(rotation: ndarray, position: ndarray) -> ndarray:
    """The angles (..., 6), rad, at which an arm without errors has its flange at poses
    (..., 3, 3), (..., 3) mm: its elbow above, its fifth joint bent forwards.

    The last three axes meet in the wrist, at the flange minus the hand h along its z.
    From the shoulder the wrist is at a distance `out` along the floor and `high` above.
    Upper arm u and forearm f reach it with the elbow bent by β and the shoulder by σ,

        cos β = (out² + high² - u² - f²) / 2uf,
        σ = atan2(out, high) - atan2(f sin β, u + f cos β).

    They are the angles of complex numbers, high + i out and u + f exp(iβ).

    The first joint turns towards the wrist, and the last three turn the forearm's
    orientation, Rz(first) Ry(σ + β), into the flange's, as Z, Y, Z.

    Raises ValueError for a place out of reach.
    """
    beside, _, height = LINKS[0]
    _, upper, fore, *_, hand = LINKS[:, 2]
    x, y, z = np.moveaxis(position - hand * rotation[..., 2], -1, 0)
    wrist = z - height + 1j * (np.hypot(x, y) - beside)
    distance = np.abs(wrist)
    cosine = (distance**2 - upper**2 - fore**2) / (2 * upper * fore)
    if (np.abs(cosine) > 1).any():
        raise ValueError(
            f"the arm's wrist is up to {distance.max():.0f} mm from its shoulder; "
            f"expected {upper - fore:.0f} to {upper + fore:.0f} mm at all poses"
        )
    first, elbow = np.arctan2(y, x), np.arccos(cosine)
    shoulder = np.angle(wrist) - np.angle(upper + fore * np.exp(1j * elbow))
    ways = np.stack([first, shoulder + elbow], axis=-1)
    forearm = Rotation.from_euler("ZY", ways).as_matrix()
    of_hand = Rotation.from_matrix(forearm.mT @ rotation).as_euler("ZYZ")
    of_arm = np.stack([first, shoulder, elbow], axis=-1)
    return np.concatenate([of_arm, of_hand], axis=-1)


def where_it_is(arm: Arm, rotation: ndarray, position: ndarray) -> Frames:
    """Where an arm really has its flange when it reports poses (P, 3, 3), (P, 3), mm,
    in a frame of the user's.

    It stands upright where the middle of the positions is before it.
    """
    foot = position.mean(axis=0) - MIDDLE
    R, p = arm.flange(joints_at(rotation, position - foot))
    return R, p + foot


@dataclass(frozen=True)
class Robot:
    """Standard deviations of a robot's errors; the entries that a specification's
    [robot] table has.
    """

    joint_deg: Sd = 0.0  # of each joint's zero, for good
    link_mm: Sd = 0.0  # of the x, y and z of each link, for good

    def built(self, rotation: ndarray, position: ndarray, rng: Generator) -> Frames:
        """Where an arm built like this has its flange when it reports poses (P, 3, 3),
        (P, 3), mm. Raises ValueError for poses out of reach.
        """
        if self == Robot():
            return rotation, position
        arm = Arm.erring(self.joint_deg, self.link_mm, rng)
        return where_it_is(arm, rotation, position)


@dataclass(frozen=True)
class Scanner:
    """A laser triangulation scanner, by default the edge paper's VLM350 (its Section
    3). Its rays fan out from behind the housing, evenly spaced at every depth.
    """

    near: float = 60.0  # mm, the measuring range in z
    far: float = 350.0  # mm
    near_width: float = 40.0  # mm, the field of view in x at `near`
    far_width: float = 160.0  # mm, at `far`
    points: Count = 980  # of a profile
    # mm in x: a sample comes from anywhere within this width around its ray
    resolution: float = 0.25
    # mm, coordinates are whole multiples of it
    quantum: Annotated[float, number(1e-6)] = 0.1
    # standard deviation of z: of a resolution of 0.2 mm, as a uniform error's width
    noise_mm: float = 0.06

    def __post_init__(self) -> None:
        narrowest = min(self.near_width, self.far_width)
        if not 0 <= self.near < self.far or narrowest <= 0:
            raise ValueError(
                "in [scanner] expected 0 <= near < far, near_width > 0 and "
                "far_width > 0"
            )

    def half_width(self, z: float | ndarray) -> Any:
        """Half the field of view in x at depth z, mm."""
        wider, deeper = self.far_width - self.near_width, self.far - self.near
        return (self.near_width + (z - self.near) * wider / deeper) / 2

    def profile(self, outline: ndarray, rng: Generator) -> ndarray:
        """A profile (points, 2) as the scanner sends it, mm, NaN where nothing is.

        `outline` (V, 2): a chain of straight pieces in the scan plane, x and z in mm.
        """
        rays = np.linspace(-1, 1, self.points)
        # as a fraction of the half width, at the mean depth of the outline's corners
        width = self.resolution / self.half_width(outline[:, 1].mean())
        blurred = rays + width * rng.uniform(-0.5, 0.5, self.points)
        z = self.first_met(outline, blurred)
        z += self.noise_mm * rng.normal(size=self.points)
        z[(z < self.near) | (z > self.far)] = np.nan
        seen = np.stack([rays * self.half_width(z), z], axis=-1)
        return self.quantum * np.round(seen / self.quantum)

    def first_met(self, outline: ndarray, rays: ndarray) -> ndarray:
        """Depth z (n,), mm, at which rays (n,) first meet an outline (V, 2) in front of
        the scanner, or NaN.

        A ray is a fraction r of the half width w(z), which is linear in z. So the
        distance in x from the ray, x - r w(z), is linear along a straight piece. A ray
        meets the piece if that has its ends to either side of the ray, where the
        distance is zero.
        """
        x, z = outline.T
        w = self.half_width(z)
        changes = np.diff(x[:, None] > np.outer(w, rays), axis=0)
        # np.nonzero of an array with two axes takes five times as long
        piece, ray = np.divmod(np.flatnonzero(changes), len(rays))
        begin, end = (x[k] - rays[ray] * w[k] for k in (piece, piece + 1))
        met = z[piece] + begin / (begin - end) * np.diff(z)[piece]
        met[met < 0] = np.nan  # behind the scanner
        depth = np.full(len(rays), np.nan)
        np.fmin.at(depth, ray, met)
        return depth
