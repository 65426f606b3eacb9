"""From a user's scans to an answer: observations, the joint solution, what speaks
against it, and what else the files may mean.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from profilecal.calibration import plausibility
from profilecal.calibration.calibration import Calibration
from profilecal.calibration.mount import disagreement, rests_on
from profilecal.calibration.observe import Seen, observe_all, questions_on
from profilecal.calibration.other_conventions import better_readings
from profilecal.calibration.several_scans import (
    agreed,
    by_scan,
    check_different,
    prefixes,
)
from profilecal.geometry.checks import UnobservableError, check_array, check_rigid
from profilecal.geometry.poses import carry
from profilecal.joint.prior import Mount, Prior, prior_from
from profilecal.joint.solution import Solution
from profilecal.joint.solve import solve
from profilecal.scan.scan import GUESS_SD, Scan, checked_guess_sd
from profilecal.targets.observations import Observations


def calibrate(
    scans: Scan | Iterable[Scan],
    guess: ArrayLike | RigidTransform | None = None,
    guess_sd: tuple[float, float] | None = None,
) -> Calibration:
    """The sensor pose from one scan or several of one sensor.

    It is the most likely one, with the places of all targets, by all measurements
    together (notebook 40), and says how far it can be believed.

    Parameters
    ----------
    scans : Scan or iterable of Scan
        What one scanner on one mount saw of one target or several.
    guess : array (4, 4) or RigidTransform, optional
        Where the sensor is believed to be, mm; left out, what a scan has of it. The
        answer is compared with it, and rests on it where the scans leave it open, as
        `messages` then say.
    guess_sd : (float, float), optional
        How good the guess is: standard deviations of each component, mm and degrees;
        infinite where it is a start for the search and no more. Left out, what the scan
        states whose guess it is, or 15 mm and 8°.

    Returns
    -------
    Calibration
        With the status "ok", "weak" (solved, but not to be relied on) or
        "unobservable" (no pose: the motions leave it open, or the data contradict each
        other). `messages` say why, and what to do.

    Raises
    ------
    ScanError
        For scans that do not belong together or hold too little.
    ValueError
        For a guess that is no pose, and a `guess_sd` without one.
    TypeError
        For what is no Scan: `Scan.of` and `read_scan` make one.

    See Also
    --------
    verify : whether another scan agrees with the answer.
    self_test : whether the stated uncertainty can be believed here.

    Examples
    --------
    >>> import numpy as np
    >>> import profilecal as pc
    >>> scan, truth = pc.simulate("disk", seed=1, groups=6, positions=10)
    >>> found = pc.calibrate(scan)
    >>> found.status
    'ok'
    >>> off = found.pose - truth.pose
    >>> bool(np.abs(off[:3, 3]).max() < 0.5)  # mm
    True
    """
    if not isinstance(scans, Iterable):
        scans = [scans]  # one scan, or what is none
    scans = tuple(scans)
    stated = agreed(scans)
    mount = mount_of(scans, guess, guess_sd)
    check_different(scans)
    seen, observed, features_mm = observe_all(scans)
    prior = replace(prior_from(stated, features_mm), mount=mount)
    poses = tuple(entry.poses for entry in seen)
    # Notes are on the files: on what was left out, and questions, which make "ok" weak.
    # Objections, and the solution's own words, are on the files as they were read: if
    # other readings explain the data, they are beside the point.
    questions = by_scan(scans, map(questions_on, scans))
    notes = *by_scan(scans, [entry.notes for entry in seen]), *questions
    try:
        solution, objections = believed(scans, seen, observed, prior)
    except UnobservableError as error:
        return Calibration(scans, poses, observed, messages=(*notes, str(error)))
    status = solution.status
    if status == "ok" and questions:
        status = "weak"
    readings = []
    if status != "ok":
        delay_ms = 1e3 * (solution.delay_s or 0.0)
        at_rest = [scan.at_rest(delay_ms) for scan in scans]
        readings = by_scan(scans, map(better_readings, at_rest, seen))
    messages = (*notes, *objections, *solution.messages)
    if readings:
        status, messages = "unobservable", (*readings, *notes)
    return Calibration(
        scans,
        poses,
        observed=tuple(solution.problem.observations),  # by the delay that was found
        status=status,
        solution_or_none=solution,
        messages=messages,
        misread=bool(readings or objections),
    )


def believed(
    scans: Sequence[Scan],
    seen: Sequence[Seen],
    observed: Sequence[Observations],
    prior: Prior,
) -> tuple[Solution, list[str]]:
    """The joint solution with the status that its residuals, the stated sides and what
    is known of the mount leave it, and sentences on what contradicts it.

    It is the solution by the scans alone; where that is not "ok", the one by scans and
    mount, if they agree, with sentences on what rests on the mount. Raises
    UnobservableError where measurements are fewer than unknowns.
    """
    mount, parts = prior.mount, parts_of(scans, seen)
    starts = [(mount.rotation, mount.translation)] if mount else []
    alone = solve(observed, replace(prior, mount=None), starts=starts)
    solution, by_residuals = plausibility.check(alone, parts)
    objections = disagreement(solution, mount)
    if mount and solution.status != "ok":
        both = solve(observed, prior, starts=starts)
        both, against = plausibility.check(both, parts)
        if not (against or disagreement(both, mount)):
            messages = (*rests_on(both, mount), *both.messages)
            solution = replace(both, messages=messages)
            by_residuals, objections = [], []  # which are on the other solution
    objections += other_sides(scans, seen, solution)
    if objections and solution.status == "ok":
        solution = replace(solution, status="weak")
    return solution, objections + by_residuals


def parts_of(scans: Sequence[Scan], seen: Sequence[Seen]) -> dict[str, ndarray]:
    """Words on what one of the scans, or a part of one, looks like if the sensor moved,
    with a place for how far, and which (profiles,) of all are of it.
    """
    parts = {}
    number = np.repeat(range(len(scans)), [len(entry.poses) for entry in seen])
    for k, (name, scan) in enumerate(zip(prefixes(scans), scans, strict=True)):
        own = number == k
        if len(scans) > 1:
            words = (
                "the sensor is {} from where the other scans have it, as if it had "
                "moved between them; calibrate them one by one"
            )
            parts[name + words] = own
        poses = seen[k].poses
        for start in len(poses) * np.arange(1, 4) // 4:
            words = (
                f"from about pose {scan.labels[poses[start]]} on the sensor is {{}} "
                "from where it was, as if it or the target had moved; scan anew"
            )
            parts[name + words] = own & (np.cumsum(own) > start)
    return parts


def mount_of(
    scans: Sequence[Scan],
    guess: ArrayLike | RigidTransform | None,
    guess_sd: Sequence[float] | None,
) -> Mount | None:
    """What is known of the mount: a guess, or the first that a scan has."""
    own_sd = GUESS_SD
    for scan in scans:
        if guess is None and scan.guess is not None:
            guess, own_sd = scan.guess, scan.guess_sd
    if guess is None:
        if guess_sd is not None:
            raise ValueError(f"guess_sd is {guess_sd}, but no guess is given")
        return None
    guess_sd = own_sd if guess_sd is None else guess_sd
    if isinstance(guess, Scan):
        raise TypeError("guess is a Scan; expected several scans as one list")
    if isinstance(guess, RigidTransform):
        guess = guess.as_matrix()
    T = check_array("guess", guess, (4, 4))
    check_rigid("guess", T[None])
    mm, deg = checked_guess_sd(guess_sd)
    return Mount(T[:3, :3], T[:3, 3], np.repeat([mm, np.radians(deg)], 3))


def other_sides(
    scans: Sequence[Scan], seen: Sequence[Seen], solution: Solution
) -> Iterator[str]:
    """Sentences on targets that the solution puts on the other side of the scan plane
    than is stated for most poses.
    """
    parts = zip(
        prefixes(scans),
        scans,
        seen,
        solution.problem.observations,
        solution.placements,
        strict=True,
    )
    for name, scan, entry, observed, target in parts:
        R, p = observed.R_flange[0], observed.T_flange[0]
        origins = carry(R, p, solution.translation)
        stated = scan.side[entry.poses]
        if stated @ target.sides(R @ solution.rotation, origins) < 0:
            yield (
                f"{name}the {scan.kind}'s centre lies on the other side of the scan "
                "plane than stated for most poses; check side, x and z of the "
                "profiles, or turn the sensor's y axis round"
            )
