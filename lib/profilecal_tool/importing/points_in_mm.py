"""Points as mm, without those that were not seen; what is uncertain is asked."""

from pathlib import Path

import numpy as np
from numpy import ndarray

from profilecal.geometry.checks import FARTHEST_MM, READINGS_MM
from profilecal.scan.tables import ScanError, listed
from profilecal_tool.importing.blocks import Blocks
from profilecal_tool.importing.makers import LENGTH_UNITS, UNIT_OF_CODE, scale_of
from profilecal_tool.importing.questions import Layout, Question, Taken, ranges

LIKELY_MM = 150.0  # the farthest that a scanner sees, for a guess at a unit
NARROW_MM = 10.0  # few scanners see so little: it may be cm or inches
A_GAP = 1 / 3  # of the extent of all points: surfaces that are seen are nearer


def in_mm(place: Path, tables: Blocks, layout: Layout) -> tuple[ndarray, Taken]:
    """The points (n, 2) of tables as mm, NaN where nothing was seen; and what was taken
    for granted. Raises ScanError; Question where a code or the unit is uncertain.
    """
    xz = np.concatenate([points.numbers_of("xz", blank=True) for points in tables])
    codes = codes_in(xz[:, 1], layout)
    unseen = np.isnan(xz).any(axis=1) | np.isin(xz[:, 1], codes)
    xz[unseen] = np.nan
    if unseen.all():
        raise ScanError(f"{place}: nothing was seen in any profile")
    # or else a user says that no height stands for nothing (--missing 1e9)
    if layout.missing in (None, *codes):
        check_codes(place, xz[~unseen], layout)
    units = units_said(tables, codes, layout)
    scale, unit = scale_of(place, units, "mm", LENGTH_UNITS)
    xz *= scale
    # a start and a pitch may have another unit than the one that is said
    check_size(place, xz, scale, bool(units) and not layout.x)
    words = listed(f"{code:.12g}" for code in codes) or "blank"
    first = tables[0]
    titles = ",".join(map(first.title, first.chosen.values()))
    return xz, {
        "columns": f"{titles}: {ranges('XZ', xz)}",
        "unit": unit,
        "missing": f"{words}: {unseen.sum()} of {len(xz)} points",
    }


def units_said(tables: Blocks, codes: list[float], layout: Layout) -> set[str]:
    """The units of points that a user says, or titles, or codes for nothing seen."""
    if layout.unit:
        return {layout.unit}
    of_titles = {column.unit for points in tables for column in points.chosen.values()}
    if of_titles == {""}:
        return {UNIT_OF_CODE.get(code, "") for code in codes} - {""}
    # x or z without a unit, beside the other in um, is none in um
    return {unit or "mm" for unit in of_titles}


def codes_in(z: ndarray, layout: Layout) -> list[float]:
    """The heights that stand for nothing seen: makers' codes and a user's, or else 0
    where all other heights lie to one side.
    """
    codes = [code for code in (*UNIT_OF_CODE, layout.missing) if (z == code).any()]
    seen = z[np.isfinite(z)]
    if layout.missing is None and 0 in seen and not seen.min() < 0 < seen.max():
        codes = codes or [0.0]
    return codes


def check_size(path: Path, xz: ndarray, scale: float, is_said: bool) -> None:
    """Raise Question where points (n, 2) mm are so near each other, so near or so far
    away that their unit, of so many mm, may be another one.
    """
    x, z = xz[~np.isnan(xz[:, 1])].T
    width, largest = np.ptp(x), np.abs([x, z]).max()
    is_narrow = 0 < width < NARROW_MM and not is_said
    if is_narrow or not READINGS_MM[0] <= largest <= FARTHEST_MM:
        usual = LIKELY_MM / largest * scale  # of the unit, in mm
        likely = min(LENGTH_UNITS, key=lambda u: abs(np.log(LENGTH_UNITS[u] / usual)))
        raise Question(
            f"{path}: {width:.4g} mm wide, up to {largest:.4g} mm away; is it the unit "
            "(of x and of z?), or a code for nothing seen (--missing)?",
            unit=likely,
        )


def check_codes(path: Path, xz: ndarray, layout: Layout) -> None:
    """Raise Question where a height may stand for nothing seen."""
    z = xz[:, 1]
    for code in (0.0, z.min(), z.max()):
        if is_likely_code(xz, code):
            count = np.count_nonzero(z == code)
            found = f"{path}: z is {code:.12g} at {count} of {len(z)} points"
            if layout.missing is not None:
                raise ScanError(f"{found}: a second code? leave them blank")
            sentence = f"{found}; was nothing seen there? (else: --missing 1e9)"
            raise Question(sentence, missing=code)


def is_likely_code(xz: ndarray, code: float) -> bool:
    """Whether a height is farther from all other points than these are from each other
    and very large, or than a third of that and recurs; or it is 0, and several points
    are 0, 0.

    >>> seen = [[0, 100], [9, 105]]
    >>> for others in ([[2, 96], [3, 96]], [[2, 96]], [[2, 1e6]], [[2, 99], [3, 99]]):
    ...     print(bool(is_likely_code(np.array(seen + others), others[0][1])))
    True
    False
    True
    False
    >>> bool(is_likely_code(np.array([[0, 0], [0, 0], [1, 5], [2, -5]]), 0))
    True
    """
    if code == 0 and (xz == 0).all(axis=1).sum() > 1:
        return True
    others = xz[xz[:, 1] != code]
    recurs = len(xz) - len(others) > 1
    if len(others) < 2 or not (recurs or abs(code) >= FARTHEST_MM):
        return False
    extent = np.ptp(others, axis=0).max()
    return np.abs(others[:, 1] - code).min() > extent * (A_GAP if recurs else 1)
