"""What all profiles of a scan tell of the scanner: where it sees something, which way depth grows."""

from dataclasses import dataclass

import numpy as np

CLEAR = 5.0  # mm beyond a run in which the scanner sees nothing, though it looked: the run ends there
LAYER = 2.0  # mm of depth that count as one


@dataclass(frozen=True)
class View:
    """The outermost points that a scanner sees at each depth, and which way is away from it."""

    points: np.ndarray  # (k, 2) mm
    away: int  # sign of z that points away from the scanner, told by its standoff; 0: not known

    @staticmethod
    def of(runs) -> "View":
        """From each profile's straight runs; spikes could be anywhere."""
        straight = [np.concatenate([run.points for run in found]) for found in runs if found]
        points = np.concatenate([*straight, np.zeros((0, 2))])
        z = points[:, 1]
        far = len(z) and np.abs(z).min() > np.median([np.ptp(p[:, 1]) for p in straight]) / 2
        away = int(np.sign(z[0])) if far and (np.sign(z) == np.sign(z[0])).all() else 0
        layer = np.round(z / LAYER)
        order = np.lexsort((points[:, 0], layer))
        first, last = (np.diff(layer[order], **{end: np.nan}) != 0 for end in ("prepend", "append"))
        return View(points[order[first | last]], away)

    def reaches_beyond(self, end, direction) -> bool:
        """Whether some profile has a point at about this depth, or nearer, clearly farther out along x."""
        deeper = self.points[:, 1] - end[1]
        like = self.away * deeper < CLEAR if self.away else np.abs(deeper) < CLEAR  # the view widens with depth
        return bool((like & ((self.points[:, 0] - end[0]) * np.sign(direction[0]) > CLEAR)).any())
