"""Candidates for a target's feature in raw profiles, and which of them it is."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from profilecal.profiles.ends import End, end_variance
from profilecal.profiles.features import Feature, nothing
from profilecal.profiles.points import Profiles

# a second candidate with this share of what supports the first leaves the choice open:
# of length, and of profiles that show it
AMBIGUOUS = 0.5


@dataclass(frozen=True)
class Candidate:
    """Something in a profile that may be the target's feature."""

    feature: Feature
    # what tells it from others of its shape; 0: nothing does
    # - of a corner: the sign of z, the way it points
    # - of a step end: the sign of x, the way from the face's middle to it
    # - of a chord: the sign of z, the way its steps lead to what is behind it
    sign: int = 0
    support: float = 0.0  # mm
    angle: float = 0.0  # rad, between the sides of a corner
    ends: tuple[End, ...] = ()  # where its points are the ends of runs

    @property
    def look(self) -> tuple[str, int]:
        """What it has in common with the target's feature in other profiles."""
        return self.feature.shape, self.sign


def ranked(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Candidates of one profile, the one of most support first."""
    return sorted(candidates, key=lambda one: -one.support)


def choose(
    profiles: Profiles,
    candidates: Sequence[Sequence[Candidate]],
    shape: str,
    reasons: Sequence[str],
) -> list[Feature]:
    """For each profile the feature, of such a shape, of its candidate if just one is
    clear; else nothing, with the reason. Candidates are ranked, the one of most support
    first. `reasons`: why a profile has none; empty where no more can be said than that.
    """
    others = f"no {shape} as in other profiles"
    if not any(candidates):
        others = "nothing like the target in any profile"
    is_open = [
        len(own) > 1 and own[1].support > AMBIGUOUS * own[0].support
        for own in candidates
    ]
    # where most leave the choice open, chance alone decides it in the others
    mostly_open = 2 * sum(is_open) > sum(map(bool, candidates))
    chosen = []
    each = zip(profiles, candidates, reasons, is_open, strict=True)
    for profile, own, reason, open_ in each:
        if not len(profile):
            reason = "nothing in this profile"
        elif open_:
            reason = f"{len(own)} candidates for the {shape}, none clearly the best"
        elif own and mostly_open:
            reason = f"most profiles have several candidates for the {shape}"
        elif own:
            chosen.append(own[0])
            continue
        chosen.append(Candidate(nothing(reason or others)))
    return with_end_variance(chosen)


def with_end_variance(chosen: list[Candidate]) -> list[Feature]:
    """The features of candidates, to whose covariance that of run ends along their runs
    is added.
    """
    counted = end_variance([end for candidate in chosen for end in candidate.ends])
    features = []
    for candidate in chosen:
        covariance = candidate.feature.covariance.copy()
        for k, end in enumerate(candidate.ends):
            along = np.outer(end.spacing, end.spacing)
            covariance[k] += (counted + end.variance) * along
        features.append(replace(candidate.feature, covariance=covariance))
    return features
