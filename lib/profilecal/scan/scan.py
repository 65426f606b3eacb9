"""A scan in memory: poses of the flange, and what the scanner saw from each."""

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform

from profilecal.geometry.checks import (
    check_array,
    check_positions,
    check_readings,
    check_rigid,
    check_rotations,
)
from profilecal.geometry.log import DELAY_S, Log
from profilecal.geometry.noise import Noise, Systematic
from profilecal.geometry.poses import (
    Frames,
    check_alike,
    homogeneous,
    inverse,
    nearest_rotation,
    rotation_groups,
)
from profilecal.scan.conventions import named, to_rotations
from profilecal.scan.tables import listed, naming, shown
from profilecal.scan.toml import (
    TABLE,
    TEXT,
    Entries,
    Rule,
    check_entries,
    entries_of,
    number,
    one_of,
)
from profilecal.targets import TARGETS
from profilecal.targets.target import Target

DELAY_MS = number(-1000 * DELAY_S, 1000 * DELAY_S)
SPEEDS = (1.0, 10_000.0)  # mm/s, of the fastest step of a log
# columns of what may be measured
MEASURED = {
    "profiles": ("x", "z"),
    "points": ("x", "z"),
    "chords": ("x_a", "z_a", "x_b", "z_b"),
    "arcs": ("x", "z", "r"),
}
# and the frame that the sensor's pose is in
MOUNTS = {"eye-in-hand": "flange", "eye-to-hand": "base"}
ENTRY_RULES: Entries = {
    "kind": one_of(TARGETS),
    "mount": one_of(MOUNTS),
    "title": TEXT,
    "truth": TABLE,
    "noise": entries_of(Noise) | entries_of(Systematic),
    "delay_ms": (lambda ms: ms is None or DELAY_MS[0](ms), DELAY_MS[1]),
}
GUESS_SD = (15.0, 8.0)  # mm and degrees, of a guess by eye
ROUNDED = 1e-12  # by which a matrix is off that was printed
Poses = ArrayLike | RigidTransform | None


def size_rules(kind: Any, scale: float = 1.0) -> dict[str, Rule]:
    """What the sizes of a target that a profile scanner can see may be, in units of
    `scale` mm.
    """
    allowed, limits = number(0.5 / scale, 1000 / scale)
    names = TARGETS.get(str(kind), Target).size_names
    return dict.fromkeys(names, (allowed, f"{limits} {'mm' if scale == 1 else 'm'}"))


@dataclass(frozen=True, eq=False, repr=False)
class Scan:
    """One scan: P poses of the flange, and what the scanner saw from each.

    `Scan.of` makes one from arrays, `read_scan` from a folder. Lengths are in mm. It is
    checked where it is made: a Scan that exists is well formed.
    """

    kind: str  # of the target, one of TARGETS
    labels: tuple[str, ...]  # P names of poses
    R_base_flange: ndarray  # (P, 3, 3)
    p_base_flange: ndarray  # (P, 3) mm
    measured: str  # one of MEASURED
    # P arrays (n, columns), mm; n is 1 but for profiles. A row of NaN: nothing was seen
    values: tuple[ndarray, ...]
    sizes: Mapping[str, float] = field(default_factory=dict)  # the target's, mm
    side: Any = 0  # (P,) 1, -1 or, where it is not known, 0
    # (P,) numbers from 0: poses of one orientation, and a sweep, share one
    group: Any = None
    group_given: bool = False  # else it is found from the orientations
    noise: Mapping[str, float] = field(default_factory=dict)  # that is known
    mount: str = "eye-in-hand"
    title: str = ""
    convention: str = "quaternion"  # in which the robot prints orientations
    # (P, k) as they were read, as long as they say the same as R_base_flange
    orientation: ndarray | None = None
    # what was measured in motion has its poses from the log, whatever is given of them
    log: Log | None = None
    times: Any = None  # (P,) s by the scanner's clock; NaN at rest
    sweeps: Sequence[str] = ()  # P names; "" at rest
    delay_ms: float | None = None  # the robot's clock less the scanner's, if known
    truth: dict = field(default_factory=dict)  # what made a simulated scan
    guess: ndarray | None = None  # (4, 4) mm, of the sensor's pose
    guess_sd: tuple[float, float] = GUESS_SD

    @classmethod
    def of(
        cls,
        kind: str,
        T_base_flange: Poses = None,
        *,
        profiles: Sequence[ArrayLike] | None = None,
        points: ArrayLike | None = None,
        chords: ArrayLike | None = None,
        arcs: ArrayLike | None = None,
        mount: str = "eye-in-hand",
        noise: Mapping[str, float] | None = None,
        side: ArrayLike = 0,
        group: ArrayLike | None = None,
        labels: Sequence[str] | None = None,
        title: str = "",
        convention: str = "quaternion",
        log: tuple[ArrayLike, Poses] | None = None,
        times: ArrayLike | None = None,
        sweeps: Sequence[str] | None = None,
        delay_ms: float | None = None,
        **sizes: float,
    ) -> "Scan":
        """A scan from arrays in memory.

        Parameters
        ----------
        kind : str
            What was scanned: "edge", "disk", "ball", "plane", "point" or "rod".
        T_base_flange : array (P, 4, 4) or RigidTransform
            Poses of the flange in the base frame, mm. `pose_matrices` makes them from
            positions and the orientations that a robot prints.
        profiles : sequence of P arrays (n, 2)
            Raw profiles, x and z in mm in scan order; points that were not seen are
            NaN, masked or left out, a profile without any is None or empty. One of
            `profiles`, `points`, `chords` and `arcs` is given.
        points : array (P, 2)
            Sensed points of an edge or a marked point, x and z in mm; NaN for none.
        chords : array (P, 4) or (P, 2, 2)
            Both ends of the chord that a disk leaves, x and z in mm; NaN for none.
        arcs : array (P, 3)
            The circle that a ball leaves, x, z and radius in mm; NaN for none.
        mount : str
            "eye-in-hand", the scanner on the flange, or "eye-to-hand", the target on
            the flange and the scanner fixed.
        noise : mapping of str to float
            Standard deviations that are known, such as ``{"profile_mm": 0.05}``: the
            entries of [noise] in scan.toml.
        side : array (P,) or int
            Ball: +1 or -1, on which side of the scan plane its centre is, which an
            answer is checked by. Disk: the same of its motion. 0: not known.
        group : array (P,), optional
            Labels that poses of one flange orientation share; left out, they are found.
        labels : sequence of P str, optional
            Names of the poses; left out, their numbers from 1.
        title : str
            One line of text.
        convention : str
            Of the numbers that the robot prints, as `pose_matrices` took them: poses
            that were read in a wrong convention can then be named.
        log, times, sweeps : arrays (L,) and (L, 4, 4); (P,); P str, optional
            What was measured in motion: times and poses of the flange that the robot
            recorded, s and mm; when each measurement was by the scanner's clock, s; and
            the name of the sweep that it is of. NaN and "" for those at rest, of which
            `T_base_flange`, `group` and `labels` then are, in their order.
        delay_ms : float, optional
            The robot's clock less the scanner's, where it is known; else it is found.
        **sizes : float
            The target's sizes in mm: ``radius`` of a disk, ball or rod.

        Raises
        ------
        ScanError
            Where an argument is wrong: one sentence with its name, the place, the value
            and what was expected.

        See Also
        --------
        read_scan : the same from a folder of files.
        calibrate : the sensor pose from scans.

        Examples
        --------
        >>> import numpy as np
        >>> import profilecal as pc
        >>> poses = np.tile(np.eye(4), (3, 1, 1))
        >>> poses[:, :3, 3] = [[400, 0, 300], [400, 20, 300], [400, 0, 320]]
        >>> scan = pc.Scan.of("edge", poses, points=[[1, 90], [2, 91], [1, 95]])
        >>> scan
        Scan(edge, 3 poses of 1 orientation, points, eye-in-hand)

        The same in motion, 20 mm in a second:

        >>> log = [0, 1, 2, 3], np.tile(np.eye(4), (4, 1, 1))
        >>> log[1][:, :3, 3] = [[400, 20 * t, 300] for t in range(4)]
        >>> t, sweeps = [1.0, 1.1, 1.2], ["there"] * 3
        >>> points = [[1, 90], [2, 91], [1, 95]]
        >>> scan = pc.Scan.of("edge", points=points, log=log, times=t, sweeps=sweeps)
        >>> scan
        Scan(edge, 3 profiles in 1 sweep, points, eye-in-hand)
        >>> scan.p_base_flange[1].round(3)
        array([400.,  22., 300.])
        """
        given = {"profiles": profiles, "points": points, "chords": chords, "arcs": arcs}
        moved = {"log": log, "times": times, "sweeps": sweeps, "delay_ms": delay_ms}
        way = None
        with naming("Scan"):
            for name, value in moved.items():
                if value is not None and (log is None or times is None):
                    raise ValueError(f"{name} given alone; expected times and log")
            if log is not None:
                t, poses = log
                along = rigid("log T", poses)
                way = checked_log(t, along[:, :3, :3], along[:, :3, 3])
            measured = the_one([name for name in given if given[name] is not None])
            T = rigid("T_base_flange", T_base_flange)
            return cls(
                kind=kind,
                labels=tuple(
                    map(str, range(1, len(T) + 1) if labels is None else labels)
                ),
                R_base_flange=T[:, :3, :3],
                p_base_flange=T[:, :3, 3],
                measured=measured,
                values=rows_by_pose(measured, given[measured]),
                sizes=sizes,
                side=side,
                group=group,
                group_given=group is not None,
                noise=noise or {},
                mount=mount,
                title=title,
                convention=convention,
                log=way,
                times=times,
                sweeps=() if sweeps is None else sweeps,
                delay_ms=delay_ms,
            )

    def __post_init__(self) -> None:
        own = vars(self)
        with naming("Scan"):
            check_entries("Scan", {n: own[n] for n in ENTRY_RULES}, ENTRY_RULES)
            named(self.convention)
            rules = size_rules(self.kind)
            sizes: Entries = dict.fromkeys(rules) | dict(self.sizes)
            check_entries("sizes of Scan", sizes, rules)
            own["sizes"] = {name: float(mm) for name, mm in sizes.items()}
            measured, target = self.measured, self.target
            if measured not in target.tables:
                raise ValueError(
                    f"a target of kind {self.kind!r} needs "
                    f"{' or '.join(target.tables)}, not {measured}"
                )
            own["noise"] = {name: float(sd) for name, sd in self.noise.items()}
            if self.guess is not None:
                own["guess"] = rigid("guess", [self.guess])[0]
            own["guess_sd"] = tuple(checked_guess_sd(self.guess_sd).tolist())
            own["values"] = self._seen()
            own.update(self._posed())
            for label, rows in zip(self.labels, self.values, strict=True):
                if len(rows) > 1 and measured != "profiles":
                    raise ValueError(
                        f"pose {label!r} has {len(rows)} rows of {measured}; "
                        "expected one"
                    )

    def _seen(self) -> tuple[ndarray, ...]:
        """The values, of one array that is not written to. Raises ValueError."""
        measured = self.measured
        if not any(map(len, self.values)):
            raise ValueError(f"no rows of {measured}; expected what was seen")
        columns = len(MEASURED[measured])
        nothing = np.full((1, columns), np.nan)
        values = [rows if len(rows) else nothing for rows in self.values]
        every = np.concatenate(values)
        check_readings(measured, every, (None, columns), finite=False)
        if measured == "arcs" and (every[:, 2] <= 0).any():
            raise ValueError(
                f"the least r of arcs is {np.nanmin(every[:, 2]):g}; expected r above 0"
            )
        every.setflags(write=False)
        ends = np.cumsum([0, *map(len, values)]).tolist()
        # np.split takes five times as long
        return tuple(every[begin:end] for begin, end in pairwise(ends))

    def _posed(self) -> Entries:
        """All that is of poses, an entry for each. Raises ValueError."""
        count, log = len(self.values), self.log
        times, sweeps = np.full(count, np.nan), ("",) * count
        if log:
            times = check_array("times", self.times, (count,), finite=False)
            sweeps = tuple(str(name).strip() for name in self.sweeps)
        still = np.isnan(times)
        posed = self._at_rest(still)
        if log:
            moved = self._in_motion(log, times, sweeps)
            moved["group"] += len({*posed["group"]})
            # where each pose stands if those at rest come first
            place = np.argsort(np.argsort(~still, kind="stable"))
            for name, values in moved.items():
                posed[name] = np.concatenate([posed[name], values])[place]
        labels = tuple(posed["labels"].tolist())
        for name, there in Counter(labels).items():
            if there > 1 or name != name.strip() or not (name and name.isprintable()):
                raise ValueError(
                    f"labels has {name!r} {there} times; expected names, each once, "
                    "that print and do not begin or end with a blank"
                )
        side = np.resize(self.side, count)
        is_known = np.isin(side, (1, -1, 0)).all() and len({*side[~still]}) < 2
        if np.shape(self.side) not in ((), (count,)) or not is_known:
            raise ValueError(
                f"side is {shown(self.side)}; expected 1, -1 or 0, for each pose, "
                "and one for all that was seen in motion"
            )
        posed |= {"side": side.astype(float), "times": np.array(times)}
        for values in posed.values():
            values.setflags(write=False)
        texts: Entries = {"labels": labels, "sweeps": sweeps, "orientation": None}
        read: Any = self.orientation
        with suppress(ValueError, TypeError):  # of another convention, or none
            R = to_rotations(named(self.convention), read)
            if np.array_equal(R, posed["R_base_flange"]):
                texts["orientation"] = read
        return posed | texts

    def _at_rest(self, still: ndarray) -> dict[str, ndarray]:
        """Labels, orientations, positions and groups of the poses at rest, `still`
        (P,). What is given is of these alone or, where `replace` makes a scan of one
        that is complete, of all.
        """
        count, given = still.sum(), len(self.p_base_flange)
        own = still if given == len(still) else np.full(given, True)
        if own.sum() != count:
            raise ValueError(
                f"T_base_flange has {given} poses for {count} {self.measured}"
                f"{' at rest' if self.log else ''}; expected one for each"
            )
        R = check_rotations("T_base_flange", self.R_base_flange, given)[own]
        p = check_positions("T_base_flange", self.p_base_flange, given)[own]
        labels = np.array(self.labels, str)
        group = np.array(self.group if self.group_given else labels)
        for name, values in {"labels": labels, "group": group}.items():
            if values.shape != own.shape:
                raise ValueError(
                    f"{name} has shape {values.shape}; expected ({given},)"
                )
        return {
            "labels": labels[own],
            "R_base_flange": R,
            "p_base_flange": p,
            "group": check_alike("T_base_flange", R, group[own])
            if self.group_given
            else rotation_groups(R),
        }

    def _in_motion(
        self, log: Log, times: ndarray, sweeps: Sequence[str]
    ) -> dict[str, ndarray]:
        """The same of what was seen in motion, at times and in sweeps (P,), each a
        group.
        """
        moving = ~np.isnan(times)
        t, names = times[moving], [*filter(None, sweeps)]
        if [*map(bool, sweeps)] != moving.tolist() or not names:
            raise ValueError(
                f"{len(names)} of {len(sweeps)} sweeps have a name, for {len(t)} "
                "times; expected a time and the name of a sweep for each profile"
            )
        pairs = zip(names, t.tolist(), strict=True)
        labels = np.array([f"{name}@{seconds}" for name, seconds in pairs])
        away = log.away(t)
        worst = away.argmax()
        if away[worst] > DELAY_S:
            raise ValueError(
                f"profile {labels[worst]} is {away[worst]:.3g} s from the nearest row "
                f"of the log, which goes from {log.t[0]:.10g} to "
                f"{log.t[-1]:.10g} s; expected times by clocks that agree within "
                f"{DELAY_S:g} s: subtract what they differ by"
            )
        R, p, _ = log.at(t + (self.delay_ms or 0.0) / 1000)
        return {
            "labels": labels,
            "R_base_flange": R,
            "p_base_flange": p,
            "group": np.unique(names, return_inverse=True)[1],
        }

    def __repr__(self) -> str:
        parts = [self.description]
        parts += in_groups(self.group[~self.moving], "pose", "of", "orientation")
        parts += in_groups(self.group[self.moving], "profile", "in", "sweep")
        return f"Scan({', '.join([*parts, self.measured, self.mount])})"

    @property
    def moving(self) -> ndarray:
        """What was measured in motion, by the robot's log, (P,)."""
        return np.isfinite(self.times)

    def at_rest(self, delay_ms: float) -> "Scan":
        """The same as if its poses had been recorded one by one, by such a delay."""
        if not self.log:
            return self
        delayed = replace(self, delay_ms=delay_ms)
        return replace(delayed, log=None, delay_ms=None, group_given=False)

    @property
    def T_base_flange(self) -> ndarray:
        """Poses (P, 4, 4) of the flange in the base frame, mm."""
        return homogeneous(self.R_base_flange, self.p_base_flange)

    @property
    def target(self) -> type[Target]:
        """The class of the target."""
        return TARGETS[self.kind]

    @property
    def description(self) -> str:
        """The target in words."""
        return described(self.kind, [*self.sizes.values()])

    def base_flange(self, poses: ndarray) -> Frames:
        """Some poses (k,) as the calibration takes them: rotations (k, 3, 3) and
        translations (k, 3) of the flange in the base frame; eye-to-hand, of the base in
        the flange frame.
        """
        R, p = self.R_base_flange[poses], self.p_base_flange[poses]
        return inverse(R, p) if self.mount == "eye-to-hand" else (R, p)


def described(kind: str, sizes: Sequence[float]) -> str:
    """A target in words."""
    named_sizes = zip(TARGETS[kind].size_names, sizes, strict=True)
    return ", ".join([kind, *(f"{name} {mm:g} mm" for name, mm in named_sizes)])


def in_groups(group: ndarray, one: str, of: str, unit: str) -> list[str]:
    """How many there are, by their groups (n,), in words; if there are any."""
    count, groups = len(group), len({*group})
    words = f"{count} {one}{'s' * (count > 1)} {of} {groups} {unit}{'s' * (groups > 1)}"
    return [words] if count else []


def the_one(found: Sequence[str], note: str = "") -> str:
    """The only one of what is found of `MEASURED`. Raises ValueError for none, or more
    than one.
    """
    if len(found) != 1:
        raise ValueError(
            f"expected one of {listed(MEASURED)}{note}; "
            f"found {' and '.join(found) or 'none of them'}"
        )
    return found[0]


def rigid(name: str, poses: Poses) -> ndarray:
    """Poses (P, 4, 4), of arrays or scipy's; none of None. Matrices that are rounded
    become rotations; those that are rotations stay as they are, to the last digit.
    Raises ValueError.
    """
    if poses is None:
        return np.empty((0, 4, 4))
    if isinstance(poses, RigidTransform):
        poses = poses.as_matrix()
    T = check_rigid(name, poses).copy()
    R = T[:, :3, :3]
    near = nearest_rotation(R)
    is_rounded = np.abs(R - near).max(axis=(1, 2), initial=0.0) > ROUNDED
    R[is_rounded] = near[is_rounded]
    return T


def checked_guess_sd(guess_sd: ArrayLike) -> ndarray:
    """Standard deviations of a guess, (2,) mm and degrees. Raises ValueError."""
    sd = check_array("guess_sd", guess_sd, (2,), finite=False)
    if not (sd > 0).all():
        raise ValueError(f"guess_sd is {guess_sd!r}; expected mm and degrees above 0")
    return sd


def rows_by_pose(measured: str, values: Any) -> tuple[Any, ...]:
    """What was measured, by pose: (P,) of (rows, columns), or () for nothing. Raises
    ValueError for arrays of another shape.
    """
    shape = None, len(MEASURED[measured])
    if measured != "profiles":
        rows = np.reshape(values, (len(values), -1)) if np.ndim(values) == 3 else values
        return tuple(check_array(measured, rows, shape, finite=False)[:, None])
    return tuple(
        ()
        if rows is None or not len(rows)
        else check_array(f"profiles[{k}]", rows, shape, finite=False)
        for k, rows in enumerate(values)
    )


def checked_log(t: ArrayLike, R: ArrayLike, p: ArrayLike) -> Log:
    """A log of times (L,), s, and poses (L, 3, 3), (L, 3), mm. Raises ValueError."""
    t = check_array("log t", t, (None,))
    R = check_array("log R", R, (len(t), 3, 3))
    p = check_positions("log p", p, len(t))
    if len(t) < 2:
        raise ValueError(f"log has {len(t)} rows; expected two or more")
    steps = np.diff(t)
    for k in np.flatnonzero(steps <= 0):
        raise ValueError(
            f"log t is {t[k + 1]:.10g} in row {k + 2}; expected later than in the row "
            "before"
        )
    fastest = (np.linalg.norm(np.diff(p, axis=0), axis=1) / steps).max()
    low, high = SPEEDS
    if not low <= fastest <= high:
        raise ValueError(
            f"log: the robot moves by {fastest:.3g} mm/s at most; "
            f"expected {low:g} to {high:g} mm/s somewhere: is t in seconds?"
        )
    return Log(*map(np.array, (t, R, p)))  # not the caller's own
