"""A target that the library does not know, a V-groove, defined here alone: from raw
profiles to an answer.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2
from simulated import squared_error, truth_of

from profilecal.calibration.answer import Answer
from profilecal.calibration.calibration import calibrate
from profilecal.calibration.observe import check
from profilecal.calibration.verify import verify
from profilecal.geometry.poses import cross
from profilecal.profiles.edges import crossing, crossing_covariance
from profilecal.profiles.points import Feature, nothing
from profilecal.profiles.runs import Run, straight_runs
from profilecal.scan.folder import read_scan, write_scan
from profilecal.simulation.spec import Spec, read_spec, simulate_scan
from profilecal.targets import TARGETS
from profilecal.targets.edge import Edge
from profilecal.targets.target import ALONG_Y, Target
from profilecal_tool.report import pictures
from profilecal_tool.words import calibration_text


@dataclass(frozen=True)
class Groove(Target):
    """A V-groove `width` wide and `depth` deep along z; x across it, y out of it, the
    origin between its shoulders.
    """

    point: np.ndarray
    axes: np.ndarray
    width: float
    depth: float

    kind, shape, lengths = "groove", "three parallel lines", ("width", "depth")
    shifts, turns, points, rows, affine = "xy", "xyz", 3, 2, True
    groups, positions, sizes, stance = 8, 4, (20.0, 8.0), ALONG_Y

    @classmethod
    def at(cls, origin, axes, sizes):
        return cls(origin, axes, *sizes)

    @property
    def frame(self):
        return self.point, self.axes

    @staticmethod
    def lines_of(sizes, origin, axes):
        """Lever and origin of the left shoulder, the bottom and the right shoulder, by
        components (.., 3, ..).
        """
        width, depth = sizes
        x, y = (
            np.array([[-width / 2], [0.0], [width / 2]]),
            np.array([[0.0], [-depth], [0.0]]),
        )
        lever = [x * a + y * b for a, b in zip(axes[0], axes[1], strict=True)]
        return lever, [o + part for o, part in zip(origin, lever, strict=True)]

    @classmethod
    def of_edges(cls, residual, origin, axes, seen, sizes):
        """What `Edge` says of each line, its torques taken about the groove's origin."""
        lever, points = cls.lines_of(sizes, origin, axes)
        r, force, torque = residual(points, axes, seen, ())
        about = [
            [t + c for t, c in zip(turn, cross(lever, f), strict=True)]
            for turn, f in zip(torque, force, strict=True)
        ]
        return r, force, about

    @classmethod
    def residual(cls, origin, axes, seen, sizes):
        return cls.of_edges(Edge.residual, origin, axes, seen, sizes)

    @classmethod
    def residual_in_space(cls, origin, axes, seen, sizes):
        return cls.of_edges(Edge.residual_in_space, origin, axes, seen, sizes)

    @staticmethod
    def fit(points):
        left, bottom, right = np.moveaxis(
            points.reshape(*points.shape[:-2], -1, 3, 3), -2, 0
        )
        along = np.concatenate(
            [
                line - line.mean(axis=-2, keepdims=True)
                for line in (left, bottom, right)
            ],
            axis=-2,
        )
        z = np.linalg.svd(along, full_matrices=False)[2][..., 0, :]
        left, bottom, right = (line.mean(axis=-2) for line in (left, bottom, right))
        x = right - left - np.sum((right - left) * z, axis=-1, keepdims=True) * z
        width = np.linalg.norm(x, axis=-1)
        x, origin = x / width[..., None], (left + right) / 2
        out = np.sum((origin - bottom) * np.cross(z, x), axis=-1)
        z = z * np.where(out < 0, -1, 1)[..., None]
        return origin, np.stack([x, np.cross(z, x), z], axis=-1), (width, np.abs(out))

    def edges(self):
        x, y, z = self.axes.T
        places = (-self.width / 2, 0.0), (0.0, -self.depth), (self.width / 2, 0.0)
        return [Edge(self.point + a * x + b * y, z) for a, b in places]

    def distance(self, points):
        return np.min([edge.distance(points) for edge in self.edges()], axis=0)

    def points_seen(self, rotation, origin, count):
        return np.stack([edge.meet(rotation, origin) for edge in self.edges()], axis=-2)

    def outline(self, specimen, rotation, origin, away):
        far = [
            Edge(self.point + a * self.axes[:, 0], self.axes[:, 2])
            for a in (-300.0, 300.0)
        ]
        chain = [far[0], *self.edges(), far[1]]
        return np.stack([edge.meet(rotation, origin) for edge in chain], axis=-2)

    @staticmethod
    def find(profiles, width, depth):
        return [groove_in(profile) for profile in profiles]

    def lines(self, points):
        return [line for edge in self.edges() for line in edge.lines(points)]


def groove_in(profile) -> Feature:
    """Where four neighbouring straight runs meet, of which the laser spot rounds the
    corners.
    """
    runs, _ = straight_runs(profile)
    if len(runs) != 4:
        return nothing(f"{len(runs)} straight runs; a groove has 4")
    rough = [crossing(*pair) for pair in pairwise(runs)]
    away = [
        np.min(
            [np.linalg.norm(profile[run.rows] - corner, axis=1) for corner in rough],
            axis=0,
        )
        for run in runs
    ]
    runs = [
        Run.through(profile, run.rows[distance > 0.5])
        for run, distance in zip(runs, away, strict=True)
    ]
    corners = sorted(
        ((crossing(*pair), pair) for pair in pairwise(runs)),
        key=lambda corner: corner[0][0],
    )
    covariances = [crossing_covariance(*pair, point) for point, pair in corners]
    used = np.concatenate([run.rows for run in runs])
    return Feature(
        np.array([point for point, _ in corners]), np.array(covariances), used, "groove"
    )


@pytest.fixture(autouse=True)
def known(monkeypatch):
    monkeypatch.setitem(TARGETS, "groove", Groove)


def test_from_raw_profiles_in_a_folder_to_an_answer_with_its_report(tmp_path):
    inside = []
    for seed in range(4):
        entries = {
            "kind": "groove",
            "seed": seed,
            "measured": "profiles",
            "depth": 9.0,
            "scanner": {"points": 500},
        }
        simulated = simulate_scan(read_spec(entries))
        write_scan(simulated, tmp_path / str(seed))
        scan = read_scan(tmp_path / str(seed))
        assert scan.measures == {"width": 20.0, "depth": 9.0}
        assert check(scan)[0] == "target         groove, width 20 mm, depth 9 mm"
        found = calibrate([scan])
        assert found.status == "ok"
        inside.append(squared_error(simulated, found))
    assert chi2.ppf(1e-4, 6 * 4) < np.sum(inside) < chi2.isf(1e-4, 6 * 4)
    assert found.to_json()["target"]["kind"] == "groove"
    assert "status         ok" in calibration_text(found)
    pictures.plot_robot(found)
    pictures.plot_profiles(scan)

    other = simulate_scan(Spec(kind="groove", seed=99))
    assert not verify(found, other).as_expected  # another sensor pose
    true = Answer(
        truth_of(simulated), found.covariance_mm_deg, found.noise_mm, found.mount
    )
    seen = verify(true, scan)
    assert seen.lengths == pytest.approx({"width": 20.0, "depth": 9.0}, abs=0.1)


def test_a_folder_without_its_lengths_is_refused(tmp_path):
    write_scan(simulate_scan(Spec(kind="groove")), tmp_path / "scan")
    header = tmp_path / "scan" / "scan.toml"
    lines = header.read_text(encoding="utf-8").splitlines()
    header.write_text(
        "\n".join(line for line in lines if not line.startswith("depth")),
        encoding="utf-8",
    )
    with pytest.raises(
        ValueError, match=r"depth is missing in \[target\]; expected 0.5 to 1000"
    ):
        read_scan(tmp_path / "scan")
