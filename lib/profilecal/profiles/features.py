"""What the target looks like in raw profiles."""

from importlib import import_module

import numpy as np

from profilecal.profiles.feature import Feature

KINDS = ("edge", "disk", "ball", "plane", "rod")
ROUND = ("disk", "ball", "rod")  # of a known radius


def find_features(kind: str, profiles, radius: float | None = None) -> list[Feature]:
    """The target's feature in each of a scan's profiles, (n, 2) mm, all of one target seen by one scanner.

    `kind` is edge, disk, ball, plane or rod; `radius` that of the disk, ball or rod, mm. The profiles are read
    together: what most of them show clearly settles which of several candidates the others show.

    Raises ValueError for another kind, a missing radius, or a profile of another shape.
    """
    if kind not in KINDS:
        raise ValueError(f"kind is {kind!r}; expected one of {', '.join(KINDS)}")
    if kind in ROUND and not (radius and radius > 0):
        raise ValueError(f"the {kind}'s radius is {radius}; expected a length in mm")
    profiles = [np.asarray(profile, dtype=float) for profile in profiles]
    for k, profile in enumerate(profiles):
        if profile.ndim != 2 or profile.shape[1] != 2:
            raise ValueError(f"profile {k} has shape {profile.shape}; expected (n, 2), x and z")

    # the targets' room comes after this one: by name, until targets are looked up in a registry of theirs
    finder = import_module(f"profilecal.targets._find_{kind}")
    return finder.find(profiles, (radius,) if kind in ROUND else ())
