"""A scan in memory: poses of the flange, and what the scanner saw from each."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
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
from profilecal.geometry.log import Log
from profilecal.geometry.noise import Noise, Systematic
from profilecal.geometry.poses import (
    Frames,
    check_alike,
    homogeneous,
    inverse,
    nearest_rotation,
    rotation_groups,
)
from profilecal.scan.conventions import CONVENTIONS, named
from profilecal.scan.motion import DELAY_MS, check_times, checked_log, moment_label
from profilecal.scan.tables import ScanError, naming
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

MEASURED = {  # what a scan may hold, and its columns
    "profiles": ("x", "z"),
    "points": ("x", "z"),
    "chords": ("x_a", "z_a", "x_b", "z_b"),
    "arcs": ("x", "z", "r"),
}
# where the scanner is, and the frame that its pose is in
MOUNTS = {"eye-in-hand": "flange", "eye-to-hand": "base"}
ENTRY_RULES: dict[str, Any] = {
    "kind": one_of(TARGETS),
    "mount": one_of(MOUNTS),
    "title": TEXT,
    "noise": entries_of(Noise) | entries_of(Systematic),
}
GUESS_SD = (15.0, 8.0)  # of a mount measured by hand or taken from a drawing


def length_rules(kind: str, scale: float = 1.0) -> dict[str, Rule]:
    """What the lengths of a target that a profile scanner can see may be, in units of
    `scale` mm.
    """
    allowed, limits = number(0.5 / scale, 1000 / scale)
    unit = "mm" if scale == 1 else "m"
    return dict.fromkeys(TARGETS[kind].lengths, (allowed, f"{limits} {unit}"))


@dataclass(frozen=True, eq=False, repr=False)
class Scan:
    """One scan: P poses of the flange, and what the scanner saw from each.

    `Scan.of` makes one from arrays, `read_scan` from a folder. Lengths are in mm. It is
    checked where it is made: a Scan that exists is well formed.
    """

    kind: str  # of the target: edge, disk, ball, plane, point or rod
    labels: tuple[str, ...]  # (P,) names of the poses
    R_base_flange: ndarray  # (P, 3, 3) orientations of the flange in the base frame
    p_base_flange: ndarray  # (P, 3) its positions there
    measured: str  # profiles, points, chords or arcs
    # (P,) of (rows, columns of MEASURED), empty where the scanner saw nothing
    values: tuple[ndarray, ...]
    sizes: tuple[float, ...] = ()  # the target's lengths
    # (P,) +1, -1, or 0 where the program is to decide
    side: Any = 0
    # (P,) numbers from 0, one for each orientation; left out, found from R_base_flange
    group: Any = None
    group_given: bool = False  # whether somebody stated the groups
    # standard deviations that are known: entries of [noise] in scan.toml
    noise: Mapping[str, float] = field(default_factory=dict)
    mount: str = "eye-in-hand"  # or "eye-to-hand"
    title: str = ""  # one line
    # of the orientations as they were read, by its name in `CONVENTIONS`
    convention: str = CONVENTIONS[0].name
    # (P, k) the convention's columns as they were read; None in motion
    orientation: ndarray | None = None
    # where something was measured in motion: the poses that the robot recorded, which
    # give R_base_flange and p_base_flange there
    log: Log | None = None
    times: Any = None  # (P,) s by the scanner's clock, NaN at rest
    sweeps: tuple[str, ...] = ()  # (P,) names, "" at rest
    # the robot's clock less the scanner's, None where it is to be found
    delay_ms: float | None = None
    truth: dict = field(default_factory=dict)  # of a simulated one; written, not read
    # (4, 4) mm, where the sensor is believed to be on the flange (eye-to-hand: in the
    # base frame), and how good that is, mm and degrees
    guess: ndarray | None = None
    guess_sd: tuple[float, float] = GUESS_SD

    @classmethod
    def of(
        cls,
        kind: str,
        T_base_flange: ArrayLike | RigidTransform | None = None,
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
        convention: str = CONVENTIONS[0].name,
        log: tuple[ArrayLike, ArrayLike | RigidTransform] | None = None,
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
        >>> poses = np.tile(np.eye(4), (3, 1, 1))
        >>> poses[:, :3, 3] = [[400, 0, 300], [400, 20, 300], [400, 0, 320]]
        >>> scan = Scan.of("edge", poses, points=[[1, 90], [2, 91], [1, 95]])
        >>> scan
        Scan(edge, 3 poses of 1 orientation, points, eye-in-hand)

        The same in motion, 20 mm in a second:

        >>> log = [0, 1, 2, 3], np.tile(np.eye(4), (4, 1, 1))
        >>> log[1][:, :3, 3] = [[400, 20 * t, 300] for t in range(4)]
        >>> times, sweeps = [1.0, 1.1, 1.2], ["there"] * 3
        >>> points = [[1, 90], [2, 91], [1, 95]]
        >>> scan = Scan.of("edge", points=points, log=log, times=times, sweeps=sweeps)
        >>> scan
        Scan(edge, 3 profiles in 1 sweep, points, eye-in-hand)
        >>> scan.p_base_flange[1].round(3)
        array([400.,  22., 300.])
        """
        check_entries("Scan", {"kind": kind}, ENTRY_RULES)
        known = length_rules(kind)
        check_entries("lengths of Scan.of", lengths, known, needed=known)
        if delay_ms is not None:
            check_entries("Scan", {"delay_ms": delay_ms}, {"delay_ms": DELAY_MS})
        measured, rows = the_one_given(
            profiles=profiles, points=points, chords=chords, arcs=arcs
        )
        recorded = None
        with naming("Scan"):
            if (log is None) != (times is None):
                given = "times" if log is None else "log"
                raise ValueError(f"{given} given alone; expected times and log")
            T = rigid("T_base_flange", T_base_flange)
            if log is not None:
                way = rigid("log T", log[1])
                recorded = checked_log(log[0], way[:, :3, :3], way[:, :3, 3])
            values = rows_by_pose(measured, rows)
        return cls(
            kind=kind,
            labels=tuple(map(str, range(1, len(T) + 1) if labels is None else labels)),
            R_base_flange=T[:, :3, :3],
            p_base_flange=T[:, :3, 3],
            measured=measured,
            values=values,
            sizes=tuple(float(lengths[name]) for name in known),
            side=side,
            group=group,
            group_given=group is not None,
            noise=noise or {},
            mount=mount,
            title=title,
            convention=named(convention).name,
            log=recorded,
            times=times,
            sweeps=tuple(str(name).strip() for name in sweeps),
            delay_ms=delay_ms,
        )

    def __post_init__(self) -> None:
        check_entries(
            "Scan", {name: getattr(self, name) for name in ENTRY_RULES}, ENTRY_RULES
        )
        count = len(self.target.lengths)
        if len(self.sizes) != count or not all(size > 0 for size in self.sizes):
            raise ScanError(f"sizes is {self.sizes}; expected {count} lengths in mm")
        P = len(self.values)
        times = self.times if self.log else np.full(P, np.nan)
        with naming("Scan"):
            times = check_array("times", times, (P,), finite=False)
            vars(self)["times"] = read_only(times)
            # poses are given of what is at rest; of all, where `replace` makes a copy
            given = len(self.p_base_flange)
            at_rest = np.count_nonzero(~self.moving)
            if given not in (at_rest, P):
                raise ScanError(
                    f"T_base_flange has {given} poses for {at_rest} {self.measured}"
                    f"{' at rest' * bool(self.log)}; expected one for each"
                )
            if self.log:
                vars(self).update(self._by_log(self.log))
            vars(self).update(self._in_final_form())
            self._check_measured()

    def _check_measured(self) -> None:
        """Refuse measurements that do not fit the target, or that are not in mm; a scan
        of nothing, and a pose with two points, chords or arcs.
        """
        expected = self.target.tables
        if self.measured not in expected:
            raise ScanError(
                f"a target of kind {self.kind!r} needs {' or '.join(expected)}, "
                f"not {self.measured}"
            )
        counts = np.array([*map(len, self.values)])
        most = counts.max(initial=0)
        if not most:
            raise ValueError(f"no rows of {self.measured}; expected what was seen")
        shape = None, len(MEASURED[self.measured])
        every = np.concatenate(self.values)
        check_readings(self.measured, every, shape, finite=False)
        if self.measured != "profiles" and most > 1:
            raise ValueError(
                f"pose {self.labels[counts.argmax()]!r} has {most} rows of "
                f"{self.measured}; expected one"
            )

    def _by_log(self, log: Log) -> Entries:
        """Labels, poses and groups of all, those in motion by the log and by sweep.

        What is given is of those at rest; or of all, where `replace` makes a scan of
        one that is complete. Orientations as they were read are dropped. Raises
        ValueError.
        """
        moving, P = self.moving, len(self.times)
        in_sweep = np.array(self.sweeps) != ""
        if len(in_sweep) != P or not in_sweep[moving].all():
            raise ValueError(
                f"{in_sweep.sum()} of {len(in_sweep)} sweeps have a name, for {P} "
                "times; expected a time and the name of a sweep for each profile"
            )

        def of_all(of_rest: Any, of_moving: Any) -> ndarray:
            """(P, ...) of what is given at rest, or of all, and in motion."""
            some = np.asarray(of_rest)
            every = np.empty((P, *some.shape[1:]), some.dtype)
            every[~moving] = some[~moving] if len(some) == P else some
            every[moving] = of_moving
            return every

        sweeps, times = np.array(self.sweeps)[moving], self.times[moving]
        names = [*map(moment_label, sweeps, times)]
        labels = of_all(np.array(self.labels, dtype=object), names)
        check_times(log, self.times, labels)
        R, p, _ = log.at(times + (self.delay_ms or 0) / 1000)
        R = of_all(self.R_base_flange, R)
        group = groups_of(self.group, R[~moving])
        number = np.unique(sweeps, return_inverse=True)[1]
        return {
            "labels": labels,
            "R_base_flange": R,
            "p_base_flange": of_all(self.p_base_flange, p),
            # sweeps are numbered behind all at rest, which are fewer than P
            "group": of_all(group, P + number),
            "orientation": None,
        }

    def _in_final_form(self) -> Entries:
        """All that is of poses, an entry for each. Raises ValueError."""
        P = len(self.values)
        R = check_rotations("T_base_flange", self.R_base_flange, P)
        p = check_positions("T_base_flange", self.p_base_flange, P)
        if len(self.labels) != P:
            raise ValueError(f"labels has {len(self.labels)} entries for {P} poses")
        for label, count in Counter(self.labels).items():
            if count > 1 or not label or label != label.strip():
                raise ValueError(
                    f"labels has {label!r} {count} times; expected names, each once"
                )
        group = groups_of(self.group, R)
        if group.shape != (P,):
            raise ValueError(f"group has shape {group.shape}; expected ({P},)")
        if self.group_given:
            still = ~self.moving
            check_alike("T_base_flange", R[still], group[still])
        side = np.asarray(self.side)
        if side.shape not in ((), (P,)) or not np.isin(side, (-1, 0, 1)).all():
            raise ValueError(f"side is {self.side}; expected 1, -1 or 0, for each pose")
        return {
            "labels": tuple(self.labels),
            "R_base_flange": read_only(R),
            "p_base_flange": read_only(p),
            "values": tuple(map(read_only, self.values)),
            "group": read_only(group),
            "sweeps": self.sweeps or ("",) * P,
            "side": read_only(np.broadcast_to(side, P).astype(float)),
            "noise": {name: float(value) for name, value in self.noise.items()},
        }

    def __repr__(self) -> str:
        parts = []
        for chosen, words in (
            (~self.moving, "{} pose{} of {} orientation{}"),
            (self.moving, "{} profile{} in {} sweep{}"),
        ):
            count, groups = np.count_nonzero(chosen), len({*self.group[chosen]})
            if groups:
                ends = ["" if number == 1 else "s" for number in (count, groups)]
                parts.append(words.format(count, ends[0], groups, ends[1]))
        what = ", ".join([self.description, *parts, self.measured, self.mount])
        return f"Scan({what})"

    @property
    def moving(self) -> ndarray:
        """What was measured in motion, by the robot's log, (P,)."""
        return np.isfinite(self.times)

    def at_rest(self, delay_ms: float) -> "Scan":
        """The same as if its poses had been recorded one by one, by such a delay."""
        if self.log is None:
            return self
        posed = replace(self, delay_ms=delay_ms)
        return replace(posed, log=None, sweeps=(), group_given=False)

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


def groups_of(group: Any, R: ndarray) -> ndarray:
    """Numbers from 0 of groups that are given, or else of those of orientations."""
    if group is None:
        return rotation_groups(R)
    return np.unique(group, return_inverse=True)[1]


def read_only(values: ndarray) -> ndarray:
    """A copy that nobody changes."""
    copy = np.array(values)
    copy.setflags(write=False)
    return copy


def rigid(name: str, poses: Any) -> ndarray:
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
    rounded = np.abs(R.mT @ R - np.eye(3)).max(axis=(1, 2)) > 1e-12
    R[rounded] = nearest_rotation(R[rounded])
    return T


def the_one_given(**measurements: Any) -> tuple[str, Any]:
    """The name and the value of the only argument that is not None. Raises ScanError
    where there is none, or more than one.
    """
    given = {name: one for name, one in measurements.items() if one is not None}
    if len(given) != 1:
        found = " and ".join(given) or "none of them"
        raise ScanError(f"expected one of {', '.join(measurements)}; found {found}")
    return given.popitem()


def rows_by_pose(measured: str, values: Any) -> tuple[ndarray, ...]:
    """What was measured, as a `Scan` has it: (P,) of (rows, columns). Raises ValueError
    for arrays of another shape.
    """
    columns = len(MEASURED[measured])
    if measured != "profiles":
        flat = np.reshape(values, (-1, columns)) if np.ndim(values) == 3 else values
        rows = check_array(measured, flat, (None, columns), finite=False)
        return tuple(rows[:, None])
    return tuple(
        check_array(f"profiles[{k}]", profile, (None, columns), finite=False)
        if profile is not None and len(profile)
        else np.empty((0, columns))
        for k, profile in enumerate(values)
    )
