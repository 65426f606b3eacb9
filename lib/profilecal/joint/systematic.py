"""What may be wrong in the same way at every pose: the profiles' scales and shape, the target's lengths.

Nobody knows these errors, but everybody knows about how large they can be. They are not estimated beside the sensor
pose; they are considered: the answer gives way to them as far as they are likely (Schmidt 1966).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from profilecal.geometry.noise import Systematic
from profilecal.joint.observations import Observations

STEP = 1e-4


@dataclass(frozen=True)
class Change:
    """Data changed by what may be wrong."""

    words: str  # with a place for the size, and [one word|another] for its sign
    unit: float  # what the size is to be multiplied by, for the words
    apply: Callable[[Observations, float], Observations]
    prior: str = ""  # the entry of `Systematic` that says how large it can be


def of_scanner() -> list[Change]:
    """Scales of the profiles, x that grows with z, and a bend."""
    words = "the profiles' {} were too [large|small] by {{:.2g}} %"
    return [
        Change(words.format("x"), 100, stretched([[1, 0], [0, 0]]), "scale_percent"),
        Change(words.format("z"), 100, stretched([[0, 0], [0, 1]]), "scale_percent"),
        Change("the profiles' x grew with z by {:+.2g} %", 100, stretched([[0, 0], [1, 0]]), "shear_percent"),
        Change("the profiles were bent by {:+.2g} mm, 50 mm from the middle", 1, bent, "bend_mm"),
    ]


def of_target(targets: Sequence) -> list[Change]:
    """Wrong lengths."""
    names = dict.fromkeys(name for target in targets for name in target.lengths)
    words = "the {} was too [large|small] by {{:.2g}} mm"
    return [Change(words.format(name), 1, lengthened(name), "tolerance_mm") for name in names]


def considered(targets: Sequence, prior: Systematic) -> list[tuple[Change, float]]:
    """What may be wrong, with its standard deviation in its own unit, of which there is none where that is 0."""
    changes = [*of_scanner(), *of_target(targets)]
    sizes = [getattr(prior, change.prior) / change.unit for change in changes]
    return [(change, size) for change, size in zip(changes, sizes, strict=True) if size]


def stretched(pattern):
    """Profiles stretched along x and z, or x moved with z: points (x, z) times 1 + step · pattern (2, 2)."""
    return lambda o, step: replace(o, points=o.points @ (np.eye(2) + step * np.array(pattern)))


def bent(o: Observations, step: float) -> Observations:
    """Profiles whose z grows with the square of x."""
    return replace(o, points=o.points + step * np.stack([0 * o.points[..., 0], (o.points[..., 0] / 50) ** 2], axis=-1))


def lengthened(name: str):
    """Targets with another length of that name."""

    def change(o, step):
        pairs = zip(o.target.lengths, o.sizes, strict=True)
        return replace(o, sizes=tuple(size + step * (other == name) for other, size in pairs))

    return change
