"""What a scanner saw from all poses, put together where the target stands still: a look
at it shows more than any number.
"""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy import ndarray

from profilecal.calibration.calibration import Calibration
from profilecal.calibration.verify import target_by
from profilecal.geometry.poses import in_base
from profilecal.scan.tables import written_whole
from profilecal_tool.report.pictures import in_space, one_scale

DRAWN = 6000  # points of a picture
PLY = """ply
format ascii 1.0
element vertex {}
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
end_header"""


@dataclass(frozen=True)
class Cloud:
    """All points of one scan, by one sensor pose."""

    points: ndarray  # (N, 3) mm, base frame (eye-to-hand: the flange's)
    pose: ndarray  # (N,) number of the pose from which each was seen
    rms_mm: float  # distance of the features kept from the target
    frame: str


def clouds_of(found: Calibration, T: ndarray) -> list[Cloud]:
    """The cloud of each scan of a calibration, by a sensor pose T (4, 4).

    Distances are from the target that fits the features of all poses kept best, so that
    they show how thick the cloud is.
    """
    clouds = []
    solution = found.solution
    delay_ms = 1e3 * (solution.delay_s or 0.0)
    every = zip(found.scans, found.observed, solution.kept, strict=True)
    for scan, observed, kept in every:
        target, points, pose = target_by(T, observed.keep(kept))
        rms_mm = np.sqrt(np.mean(target.distance(points) ** 2))
        if scan.measured == "profiles":
            flange = scan.at_rest(delay_ms).base_flange(np.arange(len(scan.values)))
            points, pose = in_base(T, scan.values, *flange)
        frame = "flange" if observed.eye_to_hand else "base"
        clouds.append(Cloud(points, pose, rms_mm, frame))
    return clouds


def plot_cloud(cloud: Cloud, title: str) -> plt.Figure:
    """Draw a cloud."""
    where = f"features lie {cloud.rms_mm:.2g} mm rms from the target"
    words = f"{title}, put together from all poses: the\n{where}"
    figure, axes = in_space(words, cloud.frame)
    few = slice(None, None, 1 + len(cloud.points) // DRAWN)
    axes.scatter(*cloud.points[few].T, c=cloud.pose[few], s=1)
    one_scale(axes)
    return figure


def write_cloud(found: Calibration, T: ndarray, path: Path) -> None:
    """Write the clouds of a calibration, as a sensor pose T (4, 4) has them, into a PLY
    file.
    """
    parts = []
    for cloud in clouds_of(found, T):
        colours = plt.cm.ScalarMappable().to_rgba(cloud.pose, bytes=True)
        parts.append(np.c_[cloud.points, colours[:, :3]])
    rows = np.concatenate(parts)
    formats = ["%.4f"] * 3 + ["%d"] * 3
    with written_whole(path) as partial:
        np.savetxt(partial, rows, formats, header=PLY.format(len(rows)), comments="")
