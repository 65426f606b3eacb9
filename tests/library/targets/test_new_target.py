"""A target that the library does not know, a V-groove, defined here alone: from raw
profiles to an answer and its report.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2
from simulated import squared_error

import profilecal as pc
from profilecal.geometry.fitting import principal_axes
from profilecal.geometry.poses import cross, unit
from profilecal.profiles.edges import crossing, crossing_covariance
from profilecal.profiles.features import Feature, nothing
from profilecal.profiles.runs import Run, straight_runs
from profilecal.targets import TARGETS
from profilecal.targets.target import ALONG_Y, Target
from profilecal_tool.report import pictures
from profilecal_tool.words import calibration_lines


@dataclass(frozen=True)
class Groove(Target):
    """A V-groove `width` wide and `depth` deep, mm: three parallel lines.

    The origin of its frame, `point` (3,), is between the shoulders. Its axes (3, 3), in
    columns, are x across the groove, y out of it and z along it.
    """

    point: np.ndarray
    axes: np.ndarray
    width: float
    depth: float

    kind = "groove"
    shape = "three parallel lines"
    size_names = ("width", "depth")
    shifts = "xy"
    turns = "xyz"
    points = 3
    rows = 2
    groups = 8
    positions = 4
    usual_sizes = (20.0, 8.0)
    stance = ALONG_Y

    @classmethod
    def at(cls, origin, axes, sizes):
        return cls(origin, axes, *sizes)

    @property
    def frame(self):
        return self.point, self.axes

    @staticmethod
    def residual(sight):
        return of_lines(pc.Edge.residual, sight)

    @staticmethod
    def residual_in_space(sight):
        return of_lines(pc.Edge.residual_in_space, sight)

    @staticmethod
    def fit(points):
        """The lines' common direction first, then where they are across it."""
        lines = points.reshape(*points.shape[:-2], -1, 3, 3)  # a pose's three points
        middles = lines.mean(axis=-3, keepdims=True)
        z = principal_axes((lines - middles).reshape(points.shape))[..., 0, :]
        left, bottom, right = np.moveaxis(middles[..., 0, :, :], -2, 0)
        across = np.cross(np.cross(z, right - left), z)
        x, origin = unit(across), (left + right) / 2
        out = np.vecdot(origin - bottom, np.cross(z, x))
        z = z * np.sign(out)[..., None]
        axes = np.stack([x, np.cross(z, x), z], axis=-1)
        return origin, axes, (np.linalg.norm(across, axis=-1), np.abs(out))

    def edges(self):
        """Its left shoulder, bottom and right shoulder."""
        x, y, z = self.axes.T
        places = line_places(self.width, self.depth)
        return [pc.Edge(self.point + a * x + b * y, z) for a, b in places]

    def distance(self, points):
        return np.min([edge.distance(points) for edge in self.edges()], axis=0)

    def lines(self, points):
        return [line for edge in self.edges() for line in edge.lines(points)]

    def outline(self, specimen, rotation, origin, away):
        """Between faces 300 mm wide."""
        x, _, z = self.axes.T
        first, last = pc.Edge(self.point - 300 * x, z), pc.Edge(self.point + 300 * x, z)
        chain = [first, *self.edges(), last]
        return np.stack([edge.meet(rotation, origin) for edge in chain], axis=-2)

    @staticmethod
    def finder(profiles, width, depth):
        return [find_groove(profile) for profile in profiles]


def line_places(width, depth):
    """Where the three lines are in the groove's frame, x and y."""
    return [(-width / 2, 0.0), (0.0, -depth), (width / 2, 0.0)]


def of_lines(residual, sight):
    """What a residual of `Edge` says of each line, about the groove's origin."""
    x, y = np.array(line_places(*sight.sizes)).T[..., None]  # (3, 1) each
    across, out, _ = sight.axes
    lever = [x * across[k] + y * out[k] for k in range(3)]
    places = [sight.origin[k] + lever[k] for k in range(3)]
    r, forces, torques = residual(sight._replace(origin=places))
    about_origin = []
    for force, torque in zip(forces, torques, strict=True):
        moment = cross(lever, force)
        about_origin.append([torque[k] + moment[k] for k in range(3)])
    return r, forces, about_origin


def find_groove(profile):
    """The corners where four neighbouring straight runs meet."""
    runs = straight_runs(profile)
    if len(runs) != 4:
        return nothing(f"{len(runs)} straight runs; a groove has 4")
    rounded = [crossing(*pair) for pair in pairwise(runs)]
    faces = [without_corners(run, rounded) for run in runs]
    pairs = sorted(pairwise(faces), key=lambda pair: crossing(*pair)[0])
    corners = [crossing(*pair) for pair in pairs]
    covariances = [
        crossing_covariance(*pair, corner)
        for pair, corner in zip(pairs, corners, strict=True)
    ]
    used = np.concatenate([face.rows for face in faces])
    return Feature(np.array(corners), np.array(covariances), used, "groove")


def without_corners(run, corners):
    """A run without its points near corners (k, 2), which the laser spot rounds, and
    where it passes for the next face, which is at less than 45°.
    """
    away = np.linalg.norm(run.points[:, None] - corners, axis=-1).min(axis=1)
    return Run.through(run.profile, run.rows[away > 1.0], run.limit)


@pytest.fixture(autouse=True)
def _known(monkeypatch):
    monkeypatch.setitem(TARGETS, "groove", Groove)


SIZES = {"width": 20.0, "depth": 9.0}


def recorded(seed):
    """A simulated scan of raw profiles, and the truth behind it."""
    choices = {"measured": "profiles", "scanner": {"points": 500}}
    return pc.simulate("groove", seed, depth=9.0, **choices)


def test_a_folder_holds_its_profiles_and_its_sizes(tmp_path):
    pc.write_scan(recorded(seed=0)[0], tmp_path)
    scan = pc.read_scan(tmp_path)
    assert scan.sizes == SIZES
    assert scan.description == "groove, width 20 mm, depth 9 mm"


def test_answers_from_its_raw_profiles_are_as_exact_as_stated():
    """The squared error of an answer over its covariance is χ² with 6 degrees of
    freedom.
    """
    scans = [recorded(seed)[0] for seed in range(4)]
    answers = [pc.calibrate(scan) for scan in scans]
    assert {answer.status for answer in answers} == {"ok"}
    total = sum(map(squared_error, answers))
    assert chi2.ppf(1e-4, 6 * 4) < total < chi2.isf(1e-4, 6 * 4)


def test_an_answer_is_reported_and_verified():
    scan, truth = recorded(seed=3)
    found = pc.calibrate(scan)
    assert found.to_json()["target"]["kind"] == "groove"
    assert ("status", "ok") in calibration_lines(found)
    pictures.plot_robot(found)
    assert [*pictures.plot_profiles(scan)]

    other_sensor, _ = pc.simulate("groove", seed=99)
    assert not pc.verify(found, other_sensor).as_expected
    covariance = found.covariance_total_mm_deg
    true = pc.Answer(truth.pose, covariance, found.noise_mm, found.mount)
    assert pc.verify(true, scan).sizes == pytest.approx(SIZES, abs=0.1)
