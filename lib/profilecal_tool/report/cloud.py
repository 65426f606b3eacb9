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
from profilecal_tool.report.pictures import in_frame, in_space

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
    pose: ndarray  # (N,) from which each was seen, in the order of the scan
    # (P,) root mean square distance of each pose's feature from the target, mm
    residuals: ndarray
    frame: str


def colours(number: ndarray) -> ndarray:
    """(n, 4) of poses by their numbers (n,), from 0."""
    return plt.get_cmap("viridis")(number / max(1, number.max()))


def clouds_of(calibration: Calibration, T: ndarray) -> list[Cloud]:
    """The cloud of each scan of a calibration, by a sensor pose T (4, 4).

    Distances are from the target that fits all features best, so that they show how
    thick the cloud is.
    """
    clouds = []
    solution = calibration.solution_or_none
    delay_ms = 1e3 * (solution.delay_s or 0.0) if solution else 0.0
    for scan, seen, observed in zip(
        calibration.scans, calibration.seen, calibration.observed, strict=True
    ):
        target, points, pose = target_by(T, observed)
        mean_square = np.bincount(pose, target.distance(points) ** 2) / np.bincount(
            pose
        )
        of_pose = seen[pose]
        if scan.measured == "profiles":
            every = scan.at_rest(delay_ms).base_flange(np.arange(len(scan.values)))
            points, of_pose = in_base(T, scan.values, *every)
        frame = "flange" if observed.eye_to_hand else "base"
        clouds.append(Cloud(points, of_pose, np.sqrt(mean_square), frame))
    return clouds


def plot_cloud(cloud: Cloud, title: str) -> plt.Figure:
    """Draw a cloud."""
    rms = np.sqrt(np.mean(cloud.residuals**2))
    where = f"features lie {rms:.2g} mm rms from the target"
    figure, axes = in_space(f"{title}, put together from all poses: the\n{where}")
    few = slice(None, None, 1 + len(cloud.points) // DRAWN)
    points, of_points = cloud.points[few], colours(cloud.pose)[few]
    axes.scatter(*points.T, c=of_points, s=1, depthshade=False)
    in_frame(axes, cloud.frame, points)
    return figure


def write_cloud(calibration: Calibration, T: ndarray, path: Path) -> None:
    """Write the clouds of a calibration, as a sensor pose T (4, 4) has them, into a PLY
    file.
    """
    clouds = clouds_of(calibration, T)
    rgb = [255 * colours(cloud.pose)[:, :3] for cloud in clouds]
    points = np.concatenate([cloud.points for cloud in clouds])
    rows = np.hstack([points, np.rint(np.concatenate(rgb))])
    head = PLY.format(len(rows))
    with written_whole(path) as partial:
        np.savetxt(partial, rows, ["%.4f"] * 3 + ["%d"] * 3, header=head, comments="")
