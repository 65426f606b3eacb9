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
    shape = T.shape
    shape_of_groups = (*shape[:-2], 1, 3)

    def error(own: float, shared: float) -> ndarray:
        """Of standard deviations `own` at each pose and `shared` by each group."""
        of_poses = own * rng.normal(size=shape)
        of_groups = shared * rng.normal(size=shape_of_groups)
        return of_poses + of_groups[..., same, :, :]

    shift = error(noise.position_mm, noise.group_position_mm)
    turn = error(noise.orientation_deg, noise.group_orientation_deg)
    R = R[..., None, :, :]
    if to_hand:
        R, T = inverse(R, T)
    return rotations(np.radians(turn)) @ R, T + shift


def revisited(R: ndarray, T: ndarray, noise: Noise, rng: Generator) -> Frames:
    """The same poses (n, 3, 3), (n, 3), mm, with the errors that are fresh whenever the
    robot comes to one.
    """
    if noise.repeatability_mm:
        T = T + noise.repeatability_mm * rng.normal(size=T.shape)
    if noise.repeatability_deg:
        turn = noise.repeatability_deg * rng.normal(size=T.shape)
        R = rotations(np.radians(turn)) @ R
    return R, T


# of the joints, all turned to zero: the arm then points straight up
AXES = np.eye(3)[[2, 1, 1, 2, 1, 2]]
MIDDLE = np.array([900.0, 0.0, 600.0])  # mm from its foot, where it works best
# mm, from each joint to the next: a reach of 1.45 m
LINKS = np.array(
    [[150, 0, 486.5], [0, 0, 700], [0, 0, 600], [0, 0, 0], [0, 0, 0], [0, 0, 65]]
)


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
        links = LINKS + link_mm * rng.normal(size=(6, 3))
        return cls(links, np.radians(joint_deg) * rng.normal(size=6))

    def flange(self, joints: ndarray) -> Frames:
        """Rotations (..., 3, 3) and positions (..., 3), mm, of the flange at joint
        angles (..., 6), rad.
        """
        R, T = np.eye(3), np.zeros(3)
        turned = rotations((joints + self.zeros)[..., None] * AXES)
        for joint, link in enumerate(self.links):
            R = R @ turned[..., joint, :, :]
            T = T + R @ link
        return R, T


def joints_at(rotation: ndarray, position: ndarray) -> ndarray:
    """The angles (..., 6), rad, at which an arm without errors has its flange at poses
    (..., 3, 3), (..., 3) mm: its elbow above, its fifth joint bent forwards.

    The last three axes meet in the wrist, at the flange minus the hand h along its z.
    From the shoulder the wrist is at a distance `out` along the floor and `high` above.
    Upper arm u and forearm f reach it with the elbow bent by β and the shoulder by σ,

        cos β = (out² + high² - u² - f²) / 2uf,
        σ = atan2(out, high) - atan2(f sin β, u + f cos β).

    The first joint turns towards the wrist, and the last three turn the forearm's
    orientation, Rz(first) Ry(σ + β), into the flange's, as Z, Y, Z.

    Raises ValueError for a place out of reach.
    """
    aside, _, up = LINKS[0]
    upper, fore, hand = LINKS[[1, 2, 5], 2]
    wrist = position - hand * rotation[..., 2]
    x, y, z = np.moveaxis(wrist, -1, 0)
    out = np.hypot(x, y) - aside
    high = z - up
    bend = (out**2 + high**2 - upper**2 - fore**2) / (2 * upper * fore)
    if (np.abs(bend) > 1).any():
        farthest = np.sqrt(out**2 + high**2).max()
        raise ValueError(
            f"the arm's wrist is up to {farthest:.0f} mm from its shoulder; "
            f"expected {upper - fore:.0f} to {upper + fore:.0f} mm at all poses"
        )
    elbow = np.arccos(bend)
    below = np.arctan2(fore * np.sin(elbow), upper + fore * np.cos(elbow))
    shoulder = np.arctan2(out, high) - below
    first = np.arctan2(y, x)
    to_forearm = np.stack([first, shoulder + elbow], axis=-1)
    forearm = Rotation.from_euler("ZY", to_forearm).as_matrix()
    last = Rotation.from_matrix(forearm.mT @ rotation).as_euler("ZYZ")
    return np.concatenate([np.stack([first, shoulder, elbow], axis=-1), last], axis=-1)


def where_it_is(arm: Arm, rotation: ndarray, position: ndarray) -> Frames:
    """Where an arm really has its flange when it reports poses (P, 3, 3), (P, 3), mm,
    in a frame of the user's.

    It stands upright where the middle of the positions is before it.
    """
    foot = position.mean(axis=0) - MIDDLE
    R, T = arm.flange(joints_at(rotation, position - foot))
    return R, T + foot


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
        if not (self.joint_deg or self.link_mm):
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
        if not (0 <= self.near < self.far and narrowest > 0):
            expected = "expected 0 <= near < far, near_width > 0 and far_width > 0"
            raise ValueError(f"in [scanner] {expected}")

    def half_width(self, z: float | ndarray) -> Any:
        """Half the field of view in x at depth z, mm."""
        widening = self.far_width - self.near_width
        width = self.near_width + widening * (z - self.near) / (self.far - self.near)
        return width / 2

    def profile(self, outline: ndarray, rng: Generator) -> ndarray:
        """A profile (points, 2) as the scanner sends it, mm, NaN where nothing is.

        `outline` (V, 2): a chain of straight pieces in the scan plane, x and z in mm.
        """
        rays = np.linspace(-1, 1, self.points)
        aside = self.resolution * rng.uniform(-0.5, 0.5, self.points)
        middle = self.half_width(outline[:, 1].mean())
        z = nearest_on_rays(outline, rays + aside / middle, self)
        z = z + self.noise_mm * rng.normal(size=self.points)
        x = rays * self.half_width(z)
        counts = np.rint(np.stack([x, z], axis=-1) / self.quantum)
        in_range = (self.near <= z) & (z <= self.far)  # false for NaN: nothing there
        return np.where(in_range[..., None], counts * self.quantum, np.nan)


def nearest_on_rays(outline: ndarray, rays: ndarray, scanner: Scanner) -> ndarray:
    """Depth z (n,), mm, at which rays (n,) first meet an outline (V, 2), or NaN.

    A ray is a fraction r of the half width w(z), which is linear in z. So the
    distance in x from the ray, x - r w(z), is linear along a straight piece. A ray
    meets the piece if that has its ends to either side of the ray, where the distance
    is zero.
    """
    x, z = outline.T
    half = scanner.half_width(z)
    right = x[:, None] > half[:, None] * rays
    # of all pairs of a piece and a ray, few meet
    begin, ray = np.nonzero(right[:-1] != right[1:])
    end = begin + 1
    from_begin = x[begin] - half[begin] * rays[ray]
    from_end = x[end] - half[end] * rays[ray]
    share = from_begin / (from_begin - from_end)
    depth = np.full(len(rays), np.nan)
    np.fmin.at(depth, ray, z[begin] + share * (z[end] - z[begin]))
    return depth
