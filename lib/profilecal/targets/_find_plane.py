"""A face in raw profiles: the dominant straight run."""

from profilecal.profiles.choice import AMBIGUOUS
from profilecal.profiles.feature import Feature, block_means, mask, nothing
from profilecal.profiles.runs import straight_runs


def find(profiles, sizes=()) -> list[Feature]:
    """The face in each profile (n, 2), mm, as up to 40 means over points of a line."""
    return [find_line(profile) for profile in profiles]


def find_line(profile) -> Feature:
    """A profile's longest straight run, if no other is nearly as long."""
    runs = sorted(straight_runs(profile)[0], key=lambda run: -run.length)
    if not runs:
        return nothing(profile, "no straight run in this profile")
    if len(runs) > 1 and runs[1].length > AMBIGUOUS * runs[0].length:
        lengths = f"{runs[0].length:.0f} and {runs[1].length:.0f} mm"
        return nothing(profile, f"two straight runs of similar length, {lengths}")
    best = runs[0]
    along, off, covariance = block_means(best.along, best.off, fitted=2)
    points = best.point + along[:, None] * best.direction + off[:, None] * best.normal
    return Feature(points, covariance, mask(profile, best.rows), "line")
