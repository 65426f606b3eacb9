"""A scan in memory: poses of the flange, and what the scanner saw from each."""

from collections import Counter
from collections.abc import Mapping, Sequence
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
from profilecal.scan.conventions import named
from profilecal.scan.tables import ScanError, listed, naming, shown
from profilecal.scan.toml import (
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
    "noise": entries_of(Noise) | entries_of(Systematic),
    "delay_ms": (lambda ms: ms is None or DELAY_MS[0](ms), DELAY_MS[1]),
}
GUESS_SD = (15.0, 8.0)  # mm and degrees, of a guess by eye
ROUNDED = 1e-12  # by which a matrix is off that was printed
Poses = ArrayLike | RigidTransform | None


def length_rules(kind: Any, scale: float = 1.0) -> dict[str, Rule]:
    """What the lengths of a target that a profile scanner can see may be, in units of
    `scale` mm.
    """
    allowed, limits = number(0.5 / scale, 1000 / scale)
    unit = "mm" if scale == 1 else "m"
    lengths = TARGETS.get(str(kind), Target).lengths
    return dict.fromkeys(lengths, (allowed, f"{limits} {unit}"))


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
    values: tuple[ndarray, ...]  # P arrays (n, columns), mm; n is 1 but for profiles
    sizes: tuple[float, ...] = ()  # the target's `lengths`, mm
    side: Any = 0  # (P,) 1, -1 or, where it is not known, 0
    # (P,) numbers from 0: poses of one orientation, and a sweep, share one
    group: Any = None
    group_given: bool = False  # not found from the orientations
    noise: Mapping[str, float] = field(default_factory=dict)  # that is known
    mount: str = "eye-in-hand"
    title: str = ""
    convention: str = "quaternion"  # in which the robot prints orientations
    orientation: ndarray | None = None  # (P, k) as they were read
    # what was measured in motion: its poses follow from the log. Those of the rest may
    # be given alone, or those of all
    log: Log | None = None
    times: Any = None  # (P,) s by the scanner's clock; NaN at rest
    sweeps: tuple[str, ...] = ()  # P names; "" at rest
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
        sweeps: Sequence[str] = (),
        delay_ms: float | None = None,
        **lengths: float,
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
            Disk and ball: +1 or -1, the side of the scan plane; 0 to decide from the
            data.
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
        **lengths : float
            The target's lengths in mm: ``radius`` of a disk, ball or rod.

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
        rules = length_rules(kind)
        check_entries("lengths of Scan.of", dict.fromkeys(rules) | lengths, rules)
        given = {"profiles": profiles, "points": points, "chords": chords, "arcs": arcs}
        way = None
        with naming("Scan"):
            measured = the_one([name for name in given if given[name] is not None])
            values = rows_by_pose(measured, given[measured])
            T = rigid("T_base_flange", T_base_flange)
            if (log is None) != (times is None):
                alone = "log" if times is None else "times"
                raise ValueError(f"{alone} given alone; expected times and log")
            if log is not None:
                along = rigid("log T", log[1])
                way = checked_log(log[0], along[:, :3, :3], along[:, :3, 3])
        return cls(
            kind=kind,
            labels=tuple(map(str, range(1, len(T) + 1) if labels is None else labels)),
            R_base_flange=T[:, :3, :3],
            p_base_flange=T[:, :3, 3],
            measured=measured,
            values=values,
            sizes=tuple(lengths[name] for name in rules),
            side=side,
            group=group,
            group_given=group is not None,
            noise=noise or {},
            mount=mount,
            title=title,
            convention=convention,
            log=way,
            times=times,
            sweeps=tuple(sweeps),
            delay_ms=delay_ms,
        )

    def __post_init__(self) -> None:
        own = vars(self)
        check_entries("Scan", {name: own[name] for name in ENTRY_RULES}, ENTRY_RULES)
        named(self.convention)
        measured, tables = self.measured, self.target.tables
        if measured not in tables:
            raise ScanError(
                f"a target of kind {self.kind!r} needs {' or '.join(tables)}, "
                f"not {measured}"
            )
        count = len(self.target.lengths)
        if len(self.sizes) != count or not all(mm > 0 for mm in self.sizes):
            raise ScanError(f"sizes is {self.sizes}; expected {count} lengths in mm")
        own["sizes"] = tuple(map(float, self.sizes))
        own["noise"] = {name: float(sd) for name, sd in self.noise.items()}
        with naming("Scan"):
            ends = np.cumsum([len(rows) for rows in self.values])
            if not ends.any():
                raise ValueError(f"no rows of {measured}; expected what was seen")
            every = np.concatenate(self.values)
            shape = None, len(MEASURED[measured])
            check_readings(measured, every, shape, finite=False)
            every.setflags(write=False)
            pairs = pairwise((0, *ends.tolist()))  # np.split takes five times as long
            own["values"] = tuple(every[begin:end] for begin, end in pairs)
            own.update(self._posed())
            for label, rows in zip(self.labels, self.values, strict=True):
                if len(rows) > 1 and measured != "profiles":
                    raise ValueError(
                        f"pose {label!r} has {len(rows)} rows of {measured}; "
                        "expected one"
                    )

    def _posed(self) -> Entries:
        """All that is of poses, an entry for each. Raises ValueError."""
        count, log, orientation = len(self.values), self.log, self.orientation
        times, sweeps = np.full(count, np.nan), ("",) * count
        if log:
            times = check_array("times", self.times, (count,), finite=False)
            sweeps = tuple(str(name).strip() for name in self.sweeps)
        moving = np.isfinite(times)
        posed = self._at_rest(~moving)
        if log:
            moved = self._in_motion(log, times, sweeps)
            orientation, groups = None, len({*posed[-1]})
            moved[-1] += groups
            # where each pose stands if those at rest come first
            place = np.argsort(np.argsort(moving, kind="stable"))
            pairs = zip(posed, moved, strict=True)
            posed = [np.concatenate(pair)[place] for pair in pairs]
        labels, R, p, group = posed
        for name, there in Counter(labels.tolist()).items():
            if there > 1 or name != name.strip() or not name:
                raise ValueError(
                    f"labels has {name!r} {there} times; expected names, each once"
                )
        is_known = np.isin(self.side, (1, -1, 0)).all()
        if np.shape(self.side) not in ((), (count,)) or not is_known:
            raise ValueError(
                f"side is {shown(self.side)}; expected 1, -1 or 0, for each pose"
            )
        arrays = {
            "R_base_flange": R,
            "p_base_flange": p,
            "group": group,
            "side": np.full(count, self.side, dtype=float),
            "times": np.array(times),
        }
        for values in arrays.values():
            values.setflags(write=False)
        texts = {"labels": tuple(labels.tolist()), "sweeps": sweeps}
        return arrays | texts | {"orientation": orientation}

    def _at_rest(self, still: ndarray) -> list[ndarray]:
        """Labels, orientations, positions and groups of the poses at rest, `still`
        (P,). What is given is of these alone or, where `replace` makes a scan of one
        that is complete, of all.
        """

        def chosen(given: Any) -> ndarray:
            values = np.array(given)
            return values[still] if values.shape[:1] == still.shape else values

        count, p = int(still.sum()), chosen(self.p_base_flange)
        if len(p) != count:
            seen = self.measured + " at rest" * (self.log is not None)
            raise ScanError(
                f"T_base_flange has {len(p)} poses for {count} {seen}; "
                "expected one for each"
            )
        R = check_rotations("T_base_flange", chosen(self.R_base_flange), count)
        check_positions("T_base_flange", p, count)
        labels = chosen(self.labels).astype(str)
        group = rotation_groups(R) if self.group is None else chosen(self.group)
        for name, values in {"labels": labels, "group": group}.items():
            if values.shape != (count,):
                raise ValueError(
                    f"{name} has shape {values.shape}; expected ({count},)"
                )
        if self.group_given:
            check_alike("T_base_flange", R, group)
        return [labels, R, p, np.unique(group, return_inverse=True)[1]]

    def _in_motion(
        self, log: Log, times: ndarray, sweeps: Sequence[str]
    ) -> list[ndarray]:
        """The same of what was seen in motion, at times and in sweeps (P,), each a
        group.
        """
        t, names = times[np.isfinite(times)], [*filter(None, sweeps)]
        if [*map(bool, sweeps)] != np.isfinite(times).tolist() or not names:
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
                f"of the log, which goes from {log.t[0]:g} to {log.t[-1]:g} s; "
                f"expected times by clocks that agree within {DELAY_S:g} s: subtract "
                "what they differ by"
            )
        R, p, _ = log.at(t + (self.delay_ms or 0.0) / 1000)
        return [labels, R, p, np.unique(names, return_inverse=True)[1]]

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
        there = replace(self, delay_ms=delay_ms)
        return replace(there, log=None, group_given=False)

    @property
    def T_base_flange(self) -> ndarray:
        """Poses (P, 4, 4) of the flange in the base frame, mm."""
        return homogeneous(self.R_base_flange, self.p_base_flange)

    @property
    def target(self) -> type[Target]:
        """The class of the target."""
        return TARGETS[self.kind]

    @property
    def measures(self) -> dict[str, float]:
        """The target's lengths by name, mm."""
        return dict(zip(self.target.lengths, self.sizes, strict=True))

    @property
    def description(self) -> str:
        """The target in words."""
        return described(self.kind, self.sizes)

    def base_flange(self, poses: ndarray) -> Frames:
        """Some poses (k,) as the calibration takes them: rotations (k, 3, 3) and
        translations (k, 3) of the flange in the base frame; eye-to-hand, of the base in
        the flange frame.
        """
        R, p = self.R_base_flange[poses], self.p_base_flange[poses]
        return inverse(R, p) if self.mount == "eye-to-hand" else (R, p)


def described(kind: str, sizes: Sequence[float]) -> str:
    """A target in words."""
    lengths = zip(TARGETS[kind].lengths, sizes, strict=True)
    return ", ".join([kind, *(f"{name} {mm:g} mm" for name, mm in lengths)])


def in_groups(group: ndarray, one: str, of: str, unit: str) -> list[str]:
    """How many there are, by their groups (n,), in words; if there are any."""
    counts = {one: len(group), unit: len({*group})}
    words = [f"{count} {name}{'s' * (count > 1)}" for name, count in counts.items()]
    return [f" {of} ".join(words)] if len(group) else []


def the_one(found: Sequence[str], note: str = "") -> str:
    """The only one of what is found of `MEASURED`. Raises ValueError for none, or more
    than one.
    """
    if len(found) != 1:
        words = " and ".join(found) or "none of them"
        raise ValueError(f"expected one of {listed(MEASURED)}{note}; found {words}")
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


def rows_by_pose(measured: str, values: Any) -> tuple[ndarray, ...]:
    """What was measured, as a `Scan` has it: (P,) of (rows, columns). Raises ValueError
    for arrays of another shape.
    """
    shape = None, len(MEASURED[measured])
    if measured != "profiles":
        rows = np.reshape(values, (len(values), -1)) if np.ndim(values) == 3 else values
        return tuple(check_array(measured, rows, shape, finite=False)[:, None])
    return tuple(
        np.empty((0, 2))
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
    return Log(t, R, p)
