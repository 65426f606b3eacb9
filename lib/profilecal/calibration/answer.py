"""A sensor pose with its uncertainty, as one calibration hands it to the next step."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import product, starmap
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from profilecal.geometry.checks import check_array, check_rigid
from profilecal.geometry.noise import Noise
from profilecal.scan.scan import MOUNTS, Scan, described
from profilecal.scan.tables import ScanError, naming
from profilecal.scan.toml import check_entries, number, one_of

# of δ = (shift, turn), and of its covariance, from mm and rad
DEGREES = np.repeat([1.0, 180 / np.pi], 3)
MM_DEG = np.outer(DEGREES, DEGREES)
MOST_PRINTS = 1000  # of a scan, in a file
EXPECTED = (
    "not what `profilecal calibrate --json` prints where it finds a sensor pose, a "
    "JSON object with that, its covariance_total, status and noise_mm; write one from "
    "another scan: profilecal calibrate SCAN --json > T.json"
)


@dataclass(frozen=True, eq=False, repr=False)  # it is some thousand numbers
class Joint:
    """All that a calibration found, by which other poses are predicted."""

    columns: list[str]  # (n,) names of the unknowns and of the errors considered
    mean: list[float]  # (n,) of what is left of them at the answer, mm and rad
    covariance: list[list[float]]  # (n, n)
    # of each target: kind, sizes, origin (3,) and axes (3, 3)
    targets: list[list]
    robot_errors: dict[str, float]  # entries of `Noise`
    freedom: float  # degrees of freedom with which these are known
    noise_factor: float  # the scanner's noise over what profiles show themselves
    # middle and steps of the robot's smooth errors, as `joint.problem` takes them
    smooth: list | None = None

    def __post_init__(self) -> None:
        n = len(self.columns)
        check_array("covariance", self.covariance, (n, n))
        sizes = [*self.mean, self.freedom, self.noise_factor]
        check_array("mean and sizes", sizes, (n + 2,))
        Noise(**self.robot_errors)
        for kind, sizes, origin, axes in self.targets:
            described(kind, sizes)
            check_array("origin and axes", [origin, *axes], (4, 3))

    def of(self, names: list[str]) -> tuple[ndarray, ndarray]:
        """Mean and covariance of these columns, zero of those that it does not have."""
        mine = np.equal.outer(names, self.columns)
        return mine @ self.mean, mine @ self.covariance @ mine.T


@dataclass(frozen=True, eq=False)
class Answer:
    """A sensor pose with its uncertainty.

    Raises ScanError where its numbers are no pose, no covariance or no noise.
    """

    # (4, 4) mm, the sensor in the flange frame (eye-to-hand: in the base frame)
    pose: ndarray
    # (6, 6) of δ = (shift, turn) in the sensor's frame, with what no residual shows:
    # the true pose is pose · exp(δ)
    covariance_total_mm_deg: ndarray
    noise_mm: float  # the scanner's
    mount: str  # "eye-in-hand" or "eye-to-hand"
    status: str = "ok"  # or "weak"
    joint: Joint | None = None  # by which `check_mount` predicts; old files have none
    # (6, 6) near the poses of its scans, without what no residual shows; left out,
    # `verify` takes the total
    covariance_mm_deg: ndarray | None = None
    # of the measurements of each scan that it is from
    fingerprints: Sequence[Sequence[str]] = ()

    def __post_init__(self) -> None:
        rules = {
            "mount": one_of(MOUNTS),
            "status": one_of(("ok", "weak")),
            "noise_mm": number(1e-9),
        }
        check_entries("Answer", {name: vars(self)[name] for name in rules}, rules)
        with naming("Answer"):
            pose = check_array("the sensor pose", self.pose, (4, 4))
            check_rigid("the sensor pose", pose[None])
            total = check_covariance(self.covariance_total_mm_deg)
            vars(self).update(pose=pose, covariance_total_mm_deg=total)
            if self.covariance_mm_deg is not None:
                near = check_covariance(self.covariance_mm_deg)
                vars(self)["covariance_mm_deg"] = near


def check_covariance(values: ArrayLike) -> ndarray:
    """A covariance (6, 6). Raises ValueError for what is none."""
    C = check_array("its covariance", values, (6, 6))
    squares = np.linalg.eigvalsh(C)
    is_positive = squares[0] >= -1e-9 * squares[-1] and squares[-1] > 0
    if not np.allclose(C, C.T) or not is_positive:
        raise ValueError("holds no covariance; expected a symmetric, positive matrix")
    return C


def fingerprints(scan: Scan) -> list[str]:
    """By which the measurements of a scan, or of a part of it, are known again: each
    by its pose to 0.001 mm, in motion by its time, and its values to 1e-6 mm. Of many
    those that are first in order, which is by chance, as hashes are.
    """
    places = np.dstack([scan.R_base_flange, scan.p_base_flange]).round(3)
    places[scan.moving] = scan.times[scan.moving, None, None]
    prints = []
    for place, rows in zip(places, scan.values, strict=True):
        valid = rows[np.isfinite(rows).all(axis=1)].round(6)
        if len(valid):
            content = [(part + 0.0).tobytes() for part in (place, valid)]  # not -0
            prints.append(sha256(b"".join(content)).hexdigest()[:12])
    return sorted(prints)[:MOST_PRINTS]


def are_the_same(prints: Sequence[str], others: Sequence[str]) -> bool:
    """Whether fingerprints are of the same measurements: more than a third of the fewer
    are among the others. Values that are noted roughly may coincide by chance.

    Where only the first of many are known, none behind the last of these count; where
    all are, all do, as no hexadecimal digit is behind "g".
    """
    both = prints, others
    last = min((own[-1] for own in both if len(own) == MOST_PRINTS), default="g")
    some = [{one for one in own if one <= last} for own in both]
    return 3 * len(set.intersection(*some)) > min(map(len, some))


def read_answer(path: str | Path) -> Answer:
    """The answer in a file, as ``profilecal calibrate --json`` prints it.

    Parameters
    ----------
    path : str or Path
        A JSON file.

    Returns
    -------
    Answer
        The sensor pose, its covariance and the scanner's noise; `verify` takes it.

    Raises
    ------
    ScanError
        Where the file is something else, or its numbers are no pose or covariance.

    See Also
    --------
    write_answer : writes such a file, with an example.
    verify : whether a scan agrees with the answer.
    """
    try:
        return answer_of(json.loads(Path(path).read_bytes()))
    except OSError as error:
        how = "profilecal calibrate SCAN --json > T.json writes one"
        raise ScanError(f"{path}: {error.strerror}; {how}") from error
    except ScanError as error:
        sentence = str(error).removeprefix("Answer: ").replace("[0]", "")
        raise ScanError(f"{path}: {sentence}") from error
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ScanError(f"{path}: {EXPECTED}") from error


def answer_of(entries: dict[str, Any]) -> Answer:
    """The answer that `Calibration.to_json` gives the entries of; with those of `made`
    it knows its measurements.
    """
    mount = "eye-to-hand" if "T_base_sensor" in entries else "eye-in-hand"
    rows = entries[f"T_{MOUNTS[mount]}_sensor"]
    made = entries.get("made") or {}
    return Answer(
        pose=np.asarray([*rows], dtype=float),  # a TypeError for null
        covariance_total_mm_deg=entries["covariance_total"],
        noise_mm=float(entries["noise_mm"]),
        mount=mount,
        status=entries["status"],
        joint=joint_of(entries.get("joint")),
        covariance_mm_deg=entries.get("covariance"),
        fingerprints=[[*map(str, of_scan)] for of_scan in made.get("scans", ())],
    )


def joint_of(entries: Any) -> Joint | None:
    """What a file says of all that was found; None where it is from a version that
    says something else.
    """
    try:
        names = Joint.__annotations__.keys() & entries
        return Joint(**{name: entries[name] for name in names})
    except (ValueError, TypeError, LookupError, AttributeError):
        return None


def checked_name(found: Answer, other: Scan | Answer) -> str:
    """The name of a scan, or of another answer, that an answer may be held against.
    Raises ScanError for another mount, and for measurements that the answer is from.
    """
    if isinstance(other, Answer):
        name, prints = "the other answer", other.fingerprints
    else:
        name, prints = other.title or f"the {other.kind}", [fingerprints(other)]
    if found.mount != other.mount:
        raise ScanError(f"{name}: the mount is {other.mount}; expected {found.mount}")
    if any(starmap(are_the_same, product(prints, found.fingerprints))):
        raise ScanError(
            f"{name}: the pose in question is from the same measurements; expected "
            "others"
        )
    return name
