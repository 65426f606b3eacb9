"""Which of several things in a profile is the target's feature: what most profiles of a scan show settles it."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from profilecal.profiles.ends import End
from profilecal.profiles.points import Feature, nothing, present

AMBIGUOUS = 0.5  # a second candidate with this share of the first one's support leaves the choice open


@dataclass(frozen=True)
class Candidate:
    """Something in a profile that may be the target's feature."""

    feature: Feature
    side: int = 0  # what tells it from others of its shape, if anything
    support: float = 0.0  # mm
    angle: float = 0.0  # rad, inner angle of a corner
    ends: tuple[End, ...] = ()  # where its points are the ends of runs

    @property
    def key(self) -> tuple[str, int]:
        """What it has in common with the target's feature in other profiles."""
        return self.feature.shape, self.side


def votes(candidates) -> Counter:
    """In how many profiles there are candidates of each key."""
    return Counter(key for found in candidates for key in {c.key for c in found})


def common_key(candidates, rank: Callable[[tuple[str, int]], int]) -> tuple[str, int] | None:
    """The key of the target's feature in this scan: the one of least `rank` of those that many profiles show.

    Many: half as many as show the most frequent one, or more. None if there are no candidates.
    """
    count, support = votes(candidates), Counter()
    for c in (c for found in candidates for c in found):
        support[c.key] += c.support
    often = [key for key in count if 2 * count[key] >= max(count.values())]
    return min(often, key=lambda key: (rank(key), -count[key], -support[key]), default=None)


def choose(profiles, candidates, key: tuple[str, int] | None, missed: Callable[[int], str] | None = None):
    """For each profile its `Candidate` with the scan's key, if just one is clear; else nothing, with the reason.

    `missed`: what a target says of a profile, by its number, that has no such candidate; "" where it cannot tell.
    """
    alike = [sorted((c for c in found if c.key == key), key=lambda c: -c.support) for found in candidates]
    angles = np.array([found[0].angle for found in alike if found])
    if not len(angles):
        return [Candidate(nothing(profile, "nothing like the target in this profile")) for profile in profiles]
    usual = np.median(angles)
    spread = 6 * np.median(np.abs(angles - usual)) if len(angles) >= 5 else np.inf
    like = np.maximum(
        np.radians([20, 30]), spread
    )  # tilted planes see corners at other angles, if nothing nearer to it
    chosen = []
    for number, (profile, found) in enumerate(zip(profiles, alike, strict=True)):
        near, far = ([c for c in found if abs(c.angle - usual) <= most] for most in like)
        near = near or far
        if not present(profile).any():
            reason = "nothing in this profile"
        elif not found:
            reason = (missed and missed(number)) or f"no {key[0]} as in other profiles"
        elif not near:
            reason = f"a corner of {np.degrees(found[0].angle):.0f}°, {np.degrees(usual):.0f}° in other profiles"
        elif len(near) > 1 and near[1].support > AMBIGUOUS * near[0].support:
            reason = f"{len(near)} candidates for the {key[0]}, none clearly the best"
        else:
            chosen.append(near[0])
            continue
        chosen.append(Candidate(nothing(profile, reason)))
    return chosen
