"""All that was seen, with the scanner's noise, as one least-squares problem."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy import ndarray

from profilecal.geometry.checks import UnobservableError
from profilecal.geometry.log import DELAY_S
from profilecal.geometry.noise import SMOOTH, Noise, Systematic, chi2_limit
from profilecal.geometry.observability import HAND_PRECISION
from profilecal.geometry.poses import Frames, carry, rotations
from profilecal.joint.linear_model import LinearModel, linear_model
from profilecal.joint.pose_groups import PoseGroups, pose_groups
from profilecal.joint.prior import (
    DELAY,
    FINEST_MM,
    Mount,
    Perturbation,
    considered,
    of_clocks,
)
from profilecal.joint.residuals import SENSOR, TARGET, Residuals
from profilecal.joint.smooth import Known, SmoothErrors, smooth_errors
from profilecal.targets.observations import Observations
from profilecal.targets.state import Batch, State

# Where the residual, and derivatives by the flange pose, stand among all columns.
RESIDUAL = -7
FLANGE = slice(-6, None)
# The precision of an unknown of which nothing is known, relative to that of a
# measurement by hand; of an error that is tried, the precision itself, in the error's
# own unit. It keeps matrices without full rank invertible.
NOTHING_KNOWN = 1e-8
# Noise levels at which Cauchy's loss gives a pose the weight of a half: little is lost
# on clean data (notebook 42).
CAUCHY = 2.385
FARTHEST_STEP = 0.1  # how far a step goes at once: rad, or hundreds of mm


@dataclass(frozen=True)
class Fit(Batch):
    """What the data say at B states, and how well these fit."""

    state: State
    normal: ndarray  # (B, n + 1, n + 1) normal equations [J r]ᵀ [J r]
    loss: ndarray  # (B,)
    per_pose: ndarray  # (B, profiles) each pose's χ² per residual

    @property
    def best_first(self) -> "Fit":
        """In the order of their losses, NaN last."""
        return self[np.argsort(self.loss)]


class Problem:
    """The residuals of all `Observations` over the scanner's noise, which is known.

    Residuals are in the scan plane, where the noise arises; or, `in_space`, distances
    in space, which exist for any pose and serve a search. Errors of the robot are part
    of the `model` alone.
    """

    def __init__(
        self,
        observations: Iterable[Observations],
        noise: Noise,
        systematic: Systematic | None = None,
        in_space: bool = False,
        mount: Mount | None = None,
        known_smooth: Known | None = None,
    ) -> None:
        self.observations = list(observations)
        self.to_hand = self.observations[0].eye_to_hand
        self.noise = noise
        self.mount = mount
        self.terms = [Residuals(seen, noise, in_space) for seen in self.observations]
        self.targets = [seen.target for seen in self.observations]
        self.systematic = systematic or Systematic()
        may_be_poor = considered(self.observations, self.systematic)
        self.considered = may_be_poor | of_clocks(self.observations)
        # what one would know of each unknown (n,) by hand, mm and rad
        mm, rad = HAND_PRECISION[::3]
        by_hand = [
            [mm] * len(one.shifts) + [rad] * len(one.turns) for one in self.targets
        ]
        self.units = np.concatenate([HAND_PRECISION, *by_hand])
        # how many residuals each profile has, in the first problem
        self.counts = np.concatenate([term.counts[0] for term in self.terms])
        self.counts_or_1 = np.maximum(self.counts, 1)  # to divide by
        # Columns stand in this order: the sensor pose (6), each target's free shifts
        # and turns, with which the n unknowns end; the c errors considered, first those
        # that may be poor, then those of clocks; those tried; the residual; the flange
        # pose (6).
        ends = np.cumsum([6, *(term.n for term in self.terms)])
        self.n = int(ends[-1])
        # which of the unknowns, and n for the residual, each term's columns are
        self.parts = [np.r_[SENSOR, slice(*own), self.n] for own in pairwise(ends)]
        self.considered_columns = slice(self.n, self.n + len(self.considered))
        self.may_be_poor = range(self.n, self.n + len(may_be_poor))
        # the column of the delay, if anything was seen in motion
        self.clock = None
        if DELAY in self.considered:
            self.clock = self.n + [*self.considered].index(DELAY)
        # middle and steps of smooth errors, if others say what they are
        self.known_smooth = known_smooth

    @property
    def delay_is_open(self) -> bool:
        """Whether something moved of whose delay nothing is known."""
        return self.considered.get(DELAY) == DELAY_S

    @property
    def frame(self) -> str:
        """The one that the sensor's pose is in."""
        return "base" if self.to_hand else "flange"

    def check_enough(self) -> None:
        """Raise UnobservableError unless more is measured than is unknown."""
        total = self.counts.sum()
        if total <= self.n:
            raise UnobservableError(
                f"{total} measured coordinates cannot determine {self.n} unknowns "
                "and noise; add poses"
            )

    @cached_property
    def groups(self) -> PoseGroups:
        """Which profiles share errors of the flange."""
        return pose_groups(self.observations)

    @property
    def poses(self) -> Frames:
        """Of the flange, of all profiles: (profiles, 3, 3), (profiles, 3)."""
        R = np.concatenate([seen.R_flange[0] for seen in self.observations])
        return R, np.concatenate([seen.T_flange[0] for seen in self.observations])

    def smooth(self, state: State) -> SmoothErrors:
        """The robot's smooth errors at a state, a batch of one."""
        pairs = zip(self.terms, state.placements, strict=True)
        middles = [term.middle(state, placement) for term, placement in pairs]
        counts = [term.P for term in self.terms]
        return smooth_errors(
            self.poses,
            (state.rotation[0], state.translation[0]),
            np.dot(counts, middles) / sum(counts),
            np.radians(self.noise.accuracy_deg) / (self.noise.accuracy_mm or 1.0),
            self.to_hand,
            self.known_smooth,
        )

    def of(self, observations: Iterable[Observations]) -> "Problem":
        """The same problem of other observations of these targets."""
        return Problem(
            observations,
            self.noise,
            self.systematic,
            in_space=self.terms[0].in_space,
            mount=self.mount,
            known_smooth=self.known_smooth,
        )

    def later(self, seconds: float) -> "Problem":
        """With what was seen in motion so much later in the robot's log."""
        return self.of(seen.later(seconds) for seen in self.observations)

    def typical(self, per_pose: ndarray) -> ndarray:
        """How many noise levels large the residuals of most poses are, (B,), by each
        pose's χ² per residual (B, profiles); at least the rounding of exact data.

        The square of it is the mean, over the targets, of a median over the poses,
        which bad poses hardly change: that of each pose's χ² over the median of χ²'s
        law, which is about 1 where residuals are as large as the noise.
        """
        ratio = per_pose * (self.counts_or_1 / chi2_limit(0.5, self.counts_or_1))
        medians = [np.median(own, axis=0) for own in self.split(ratio.T)]
        size = np.sqrt(np.mean(medians, axis=0))
        return np.maximum(size, FINEST_MM / self.noise.profile_mm)

    def split(self, profiles: ndarray) -> list[ndarray]:
        """What is of all profiles (profiles, ...), for each target (P, ...)."""
        return np.split(profiles, np.cumsum([term.P for term in self.terms])[:-1])

    def moments(self, state: State, scale: ndarray | None = None) -> Fit:
        """The normal equations and the loss at B states.

        `scale` (B,): Cauchy's loss with that many noise levels as its unit; None: least
        squares.

        A pose whose residuals, `count` of them, have the mean square q costs
        count · u log(1 + q / u) in Cauchy's loss, u the square of `scale` times CAUCHY.
        To first order that is least squares with the weight 1 / (1 + q / u).
        """
        B = len(state.rotation)
        normal = np.zeros((B, self.n + 1, self.n + 1))
        loss = np.zeros(B)
        per_pose = []
        terms = zip(self.parts, self.terms, state.placements, strict=True)
        for own, term, placement in terms:
            z = term.over_noise(term.linearise(state, placement))
            r = z[:, -1]
            count = np.maximum(term.counts, 1)
            square = np.einsum("bkp,bkp->bp", r, r) / count
            per_pose.append(square)
            if scale is not None:
                unit = (CAUCHY * scale[:, None]) ** 2
                loss += (count * unit * np.log1p(square / unit)).sum(axis=1)
                z /= np.sqrt(1 + square / unit)[:, None, None]
            flat = z.reshape(B, z.shape[1], -1)
            normal[:, own[:, None], own] += flat @ flat.mT
        of_mount = self.of_mount(state, self.n)
        normal += of_mount
        loss += of_mount[:, -1, -1]
        if scale is None:  # the corner has Σ r² and the mount's part already
            loss = normal[:, -1, -1]
        return Fit(state, normal, loss, np.concatenate(per_pose, axis=1))

    def of_mount(self, state: State, n: int) -> ndarray:
        """What is known of the mount, as normal equations (B, n + 1, n + 1)."""
        if not self.mount:
            return np.zeros((1, n + 1, n + 1))
        return self.mount.normal(state.rotation, state.translation, n)

    def columns_in_mm(
        self, state: State, tried: Sequence[Perturbation] = ()
    ) -> list[ndarray]:
        """Each target's residuals in the first problem, at a state, a batch of one, and
        their derivatives by all that may be wrong.

        Returns (1, n + c + d + 7, K, P) for each target: the derivatives by all n
        unknowns, by the c errors considered and the d errors `tried`; the residual; and
        the derivatives by the flange pose (6).

        Derivatives are taken where the state has the points: at the noisy points they
        follow the noise, and all lengths look too small.
        """
        errors = [*self.considered, *tried]
        columns = []
        terms = zip(self.parts, self.terms, state.placements, strict=True)
        for own, term, placement in terms:
            measured = term.linearise(state, placement)
            ideal = term.on_target(measured)
            slopes = ideal.linearise(state, placement)
            by_flange = ideal.by_flange(slopes, state)
            z = np.zeros((1, self.n + len(errors) + 7, *slopes.shape[2:]))
            z[:, own[:-1]] = slopes[:, :-1]
            at = state, placement, slopes, by_flange
            each = {error: ideal.by_error(error, *at) for error in {*errors}}
            for column, error in enumerate(errors, self.n):
                z[:, column] = each[error]
            z[:, RESIDUAL] = measured[:, -1]
            z[:, FLANGE] = by_flange
            z[~np.isfinite(z)] = 0.0
            columns.append(z)
        return columns

    def model(
        self,
        state: State,
        names: Sequence[str],
        tried: Sequence[Perturbation] = (),
    ) -> LinearModel:
        """The linear model at a state, a batch of one, with errors of the robot of
        these `names`, entries of `Noise`. Of the errors `tried` nothing is known
        beforehand.

        Where SMOOTH is not among the names, smooth errors are known to be as large as
        the noise says, and their columns are the last of A. Then x has 27 entries more
        than `rms_mm` takes. `solve` never comes here, as the names of a prior have
        SMOOTH wherever there are smooth errors; plans and mount checks do.
        """
        columns = self.columns_in_mm(state, tried)
        # (profiles, K, n + c + d + 7), with zeros where a target has fewer residuals
        K = max(z.shape[2] for z in columns)
        whole = np.zeros((len(self.counts), K, columns[0].shape[1]))
        for term, z, own in zip(self.terms, columns, self.split(whole), strict=True):
            over_noise = term.over_noise(z)[0]  # (columns, K, P)
            own[:, : z.shape[2]] = over_noise.transpose(2, 1, 0)
        precision = np.r_[
            NOTHING_KNOWN / self.units**2,
            np.power([*self.considered.values()], -2.0),
            np.full(len(tried), NOTHING_KNOWN),
        ]
        by_flange, rows = whole[..., FLANGE], whole[..., : FLANGE.start]
        smooth, accuracy_mm = None, self.noise.accuracy_mm
        fresh = [name for name in names if name != SMOOTH]
        if SMOOTH in names:
            smooth = self.smooth(state)
        elif accuracy_mm:
            B = self.smooth(state).columns(by_flange)
            rows = np.concatenate([rows[..., :-1], B, rows[..., -1:]], axis=2)
            precision = np.append(precision, np.full(B.shape[2], accuracy_mm**-2.0))
        return linear_model(
            by_flange,
            rows,
            self.counts,
            self.groups,
            fresh,
            np.diag(precision),
            self.clock,
            smooth,
            of_mount=self.of_mount(state, len(precision))[0],
            may_be_poor=self.may_be_poor,
        )

    def rms_mm(self, state: State, x: ndarray, profiles: ndarray) -> float:
        """Root mean square of the residuals of some profiles (profiles,), to first
        order, after a step x (n + c,) of the unknowns and of the errors considered from
        a state, a batch of one.
        """
        x, square = np.append(x, 1.0), 0.0
        columns = self.columns_in_mm(state)
        for (z,), chosen in zip(columns, self.split(profiles), strict=True):
            residual = np.tensordot(x, z[: FLANGE.start], 1)
            square += np.sum(residual[:, chosen] ** 2)
        return float(np.sqrt(square / self.counts[profiles].sum()))

    def move(self, state: State, step: ndarray, anew: bool = False) -> State:
        """The state after a step (B, n). `anew`: with targets placed anew where that is
        best.
        """
        shifted = carry(state.rotation, state.translation, step[:, :3])
        turned = state.rotation @ rotations(step[:, 3:6])
        placements = []
        terms = zip(self.terms, state.placements, self.parts, strict=True)
        for term, placement, own in terms:
            if anew and term.target.fit_is_best:
                placements.append(term.place(turned, shifted))
            else:
                placements.append(term.move(placement, step[:, own[TARGET]]))
        return State(turned, shifted, tuple(placements))

    def after_step(self, state: State, x: ndarray) -> tuple["Problem", State]:
        """The problem and the state, a batch of one, after a step x (n + c,), or after
        as much of it as goes no farther than FARTHEST_STEP. Further delays count from
        the new one, as if the new one were as likely as none.
        """
        step = x[None, : self.n]
        share = FARTHEST_STEP / max(FARTHEST_STEP, reach(step)[0])
        state = self.move(state, step * share)
        if self.clock is None:
            return self, state
        return self.later(x[self.clock] * share), state

    def place(self, rotation: ndarray, translation: ndarray) -> State:
        """Sensor poses (B, 3, 3), (B, 3) with each target placed where they see it."""
        placements = tuple(term.place(rotation, translation) for term in self.terms)
        return State(rotation, translation, placements)


def reach(step: ndarray) -> ndarray:
    """How far steps (B, 6 or more) move sensor poses, rad or hundreds of mm."""
    return np.abs(step[:, :6] / [100, 100, 100, 1, 1, 1]).max(axis=1)
