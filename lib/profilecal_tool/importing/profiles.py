"""Profiles in files: their points, in mm, and what tells them apart."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy import ndarray
from pandas import DataFrame, Series

from profilecal.scan.scan import FARTHEST_MM
from profilecal.scan.tables import ScanError, Table, listed, naming, number
from profilecal_tool.importing.answers import Layout, Question, only, scale_of
from profilecal_tool.importing.blocks import Block
from profilecal_tool.importing.makers import CODES, LENGTHS, SETS
from profilecal_tool.importing.roles import (
    Column,
    columns_of,
    meaning,
    numbered,
    poses_in,
)

FEWEST = 8  # numbered columns that are the points of a profile


@dataclass(frozen=True)
class Profiles:
    """All points, by profile."""

    place: Path
    names: list[str]
    counts: list[int]  # of points
    xz: ndarray  # (n, 2)
    units: set[str]
    titles: str  # of x and z


def numbers(block: Block, at: Sequence[int]) -> ndarray:
    """Columns as numbers (rows, columns), NaN for blanks. Raises ScanError."""
    names = [block.titles[k] for k in at]
    if len({*names}) < len(names):
        names = [str(k + 1) for k in at]
    cells = (block.table.iloc[:, k].to_numpy() for k in at)
    columns = dict(zip(names, cells, strict=True))
    return Table(block.path, columns, block.table.index).numbers(names, blank=True)


def in_points(block: Block, layout: Layout) -> Block:
    """A block with a point in each row, of one with a profile in each, or with z alone.

    Raises ScanError where x is nowhere.
    """
    columns = columns_of(block)
    titles = np.array([*map(number, block.titles)])
    stems = {meaning(0, stem).role: own for stem, own in numbered(columns).items()}
    x, z = ([c.at for c in stems.get(axis, [])] for axis in "xz")
    places = numbers(block, x) if x and len(x) == len(z) else None
    if block.is_bare:
        z, places = [*range(len(titles))], None
    elif np.isfinite(titles).sum() >= FEWEST:
        z = np.flatnonzero(np.isfinite(titles))
        places = titles[z]
    axis = [c.at for c in columns if c.role == "axis"]  # Gocator's rows of X and of Z
    if axis and len(z) >= FEWEST:
        is_x = block.table.iloc[:, axis[0]].str.lower() == "x"
        places = numbers(replace(block, table=block.table[is_x]), z)
        block = replace(block, table=block.table[~is_x])
    heights = [c.at for c in columns if c.role == "z"]
    if len(z) >= FEWEST and not (block.is_bare and len(z) <= 16):
        rows = numbers(block, z)
    elif len(heights) == 1 and not {"x", "y", ""} & {c.role for c in columns}:
        rows, places = numbers(block, heights).T, None
    else:
        return block
    if places is None:
        start, pitch = layout.x or x_above(block)
        places = start + pitch * np.arange(rows.shape[1])
    names = [c.at for c in columns if c.role == "label"]
    labels = np.arange(1, len(rows) + 1)
    if names and len(rows) == len(block.table):
        labels = block.table.iloc[:, names[0]].to_numpy()
    table = {"label": labels.repeat(rows.shape[1])}
    table |= {"x": np.broadcast_to(places, rows.shape).ravel(), "z": rows.ravel()}
    return replace(block, table=DataFrame(table), titles=[*table])


def x_above(block: Block) -> tuple[float, float]:
    """The start and the pitch of x in the words above z. Raises ScanError."""
    above = re.sub(r" +", "_", block.above.lower())
    found = []
    for which in ("start", "pitch"):
        line = rf"(?:{'|'.join(SETS[which])})_?(?:[(\[]\w+[)\]])?[_,;:=\t]+([-+\d.]+)"
        found += re.findall(line, above)[:1]
    if len(found) < 2:
        raise ScanError(
            f"{block.path}: z alone, and x nowhere: --x START PITCH says it; or give "
            "titles: x1, z1, x2, z2, … where they take turns"
        )
    return float(found[0]), float(found[1])


def pair_in(block: Block, said: str) -> tuple[Column, ...]:
    """The columns of x and z; none where there are none. Raises Question."""
    columns = columns_of(block)
    if said:
        known = [meaning(k, title) for k, title in enumerate(block.titles)]
        names = [meaning(0, name) for name in said.split(",")]
        own = [
            column._replace(unit=one.unit or column.unit)
            for one in names
            for column in known
            if one.name in (column.name, str(column.at + 1))
        ]
        return tuple(own) if len(own) == 2 else ()
    of_poses = {c.at for own in poses_in(columns).values() for c in own.values()}
    free = [column for column in columns if column.at not in of_poses]
    pairs = {
        f"{block.titles[x.at]},{block.titles[z.at]}": (x, z)
        for x in free
        for z in free
        if (x.role, z.role) == ("x", "z") and x.of == z.of
    }
    if not pairs or (len(pairs) > 1 and len(block.table) < 2):
        return ()
    return only(block.path, pairs, "columns are x and z", "columns")


def where(block: Block, said: str) -> Block:
    """The rows in which a column has a value: "sensor=0"."""
    name, _, value = said.lower().partition("=")
    for column in columns_of(block):
        if said and name == column.name:
            cells = block.table.iloc[:, column.at]
            is_text = cells.dtype.kind not in "fiu"
            own = cells.str.lower() == value if is_text else cells == float(value)
            return replace(block, table=block.table[own])
    return block


def labels_of(block: Block, count: int) -> ndarray | None:
    """What tells the profiles in rows apart: a column whose values come once each."""
    columns = columns_of(block)
    for role in ("label", "time", "t"):
        for column in columns:
            cells = block.table.iloc[:, column.at].to_numpy()
            if column.role == role and len(cells):
                runs = 1 + np.count_nonzero(cells[1:] != cells[:-1])
                counts_points = role == "label" and runs == len(cells) != count
                if runs == Series(cells).nunique() and not counts_points:
                    return cells
    return None


def check_one(block: Block, pair: Sequence[Column], labels: ndarray) -> None:
    """Raise Question where rows of a profile are of several scanners or sections."""
    for column in columns_of(block):
        is_y = column.role == "y" and column.of == pair[0].of
        if column in pair or not (is_y or column.role in ("sensor", "label")):
            continue
        cells = Series(block.table.iloc[:, column.at].to_numpy())
        if np.array_equal(cells, labels):
            continue
        each = cells.groupby(labels).agg(["nunique", "size"])
        few = column.role == "sensor" or (2 * each["nunique"] <= each["size"]).all()
        if few and (each["nunique"] > 1).any():
            values = sorted(cells.unique())
            one = min(values, key=abs) if is_y else values[0]
            sentence = f"{column.name} is {values[0]} to {values[-1]} in one profile"
            raise Question(f"{block.path}: {sentence}", where=f"{column.name}={one}")


def tables_in(blocks: Iterable[Block], layout: Layout) -> list[tuple]:
    """The blocks with points, and their columns x and z. Raises Question."""
    blocks = [where(block, layout.where) for block in blocks]
    found = []
    for block in blocks:
        with naming(block.path):
            own = in_points(block, layout)
        if pair := pair_in(own, layout.columns):
            found.append((own, pair))
    most = max((block.table.size for block in blocks), default=0)
    if most > max([block.table.size for block, _ in found], default=0):
        return []  # what is not known may be the profile
    named = [one for one in found if name_of(*one) == (layout.entry or "profile")]
    return named or found


def name_of(block: Block, pair: Sequence[Column]) -> str:
    """What points are called, or where they stand."""
    return block.name or pair[0].of or f"line {block.table.index[0]}"


def read_profiles(
    files: Iterable[tuple[Path, list[Block]]],
    one_each: bool,
    layout: Layout,
    count: int,
    of_rows: ndarray | None,
) -> Profiles:
    """The profiles in files: one in each, or those of `count` poses in one, where
    `of_rows` may be the pose of each row. Raises ScanError.
    """
    names, counts, parts, units, titles = [], [], [], set(), ""
    for path, blocks in files:
        found = tables_in(blocks, layout)
        kinds = {(one[0].name, *one[0].titles) for one in found}
        if len(found) > 1 and (one_each or len(kinds) > 1):
            tables = [name_of(*one) for one in found]
            sentence = f"which is the profile, {' or '.join(tables)}?"
            raise Question(f"{path}: {sentence}", entry=tables[0])
        if not found and any(len(block.table) > 1 for block in blocks):
            sentence = f"no x and z in columns {listed(blocks[0].titles)}"
            raise Question(f"{path}: {sentence}", columns=likely(blocks))
        for block, pair in found:
            labels = None if one_each else labels_of(block, count)
            labels = of_rows if of_rows is not None else labels
            evenly = count * (not one_each and len(found) == 1)
            begins = begins_of(block, pair, labels, evenly)
            counts += np.diff([*begins, len(block.table)]).tolist()
            names += [] if labels is None else map(str, labels[begins])
            parts.append(numbers(block, [column.at for column in pair]))
            units |= {column.unit for column in pair}
            titles = titles or ",".join(block.titles[column.at] for column in pair)
        if one_each:
            names.append(path.stem)
            counts += [0] * (not found)
    names = names or [*map(str, range(1, len(counts) + 1))]
    if not parts:
        raise ScanError(f"{path}: no profiles in it")
    xz = np.concatenate(parts) if len(parts) > 1 else parts[0]
    return Profiles(path, names, counts, xz, units, titles)


def begins_of(
    block: Block, pair: Sequence[Column], labels: ndarray | None, evenly: int
) -> list[int]:
    """The rows where profiles begin: with a label, or evenly where there are none."""
    groups = np.zeros(len(block.table)) if labels is None else labels
    check_one(block, pair, groups)
    if labels is None and evenly and len(groups) % evenly == 0:
        return [*range(0, len(groups), len(groups) // evenly)]
    return [0, *(np.flatnonzero(groups[1:] != groups[:-1]) + 1).tolist()]


def likely(blocks: Sequence[Block]) -> str:
    """The last two columns that are not the same in all rows, by number."""
    table = max(blocks, key=lambda block: len(block.table)).table
    varying = [k for k in range(table.shape[1]) if table.iloc[:, k].nunique() > 1]
    return ",".join(str(k + 1) for k in varying[-2:])


def codes_of(z: ndarray, missing: float | None) -> list[float]:
    """The numbers that stand where nothing was seen: those said or known, and zero
    where all else lies to one side.
    """
    codes = [code for code in CODES if (z == code).any()]
    codes += [] if missing is None else [missing]
    lowest = np.nanmin(z, initial=0)
    digits = f"{lowest:.7g}".strip("-").replace(".", "")
    if len(digits) > 2 and {*digits} == {"9"}:  # of -999.999 in any unit
        codes.append(lowest)
    rest = z[~np.isin(z, codes) & np.isfinite(z)]
    has_zeros = missing is None and (rest == 0).any() and rest.any()
    return codes + [0.0] * bool(has_zeros and rest.min() * rest.max() == 0)


def to_mm(profiles: Profiles, layout: Layout, taken: dict[str, str]) -> None:
    """Make points mm, and NaN where nothing was seen. Raises ScanError."""
    xz = profiles.xz
    codes = codes_of(xz[:, 1], layout.missing)
    unseen = np.isnan(xz).any(axis=1) | np.isin(xz[:, 1], codes)
    xz[unseen] = np.nan
    of_codes = {CODES[code] for code in codes if CODES.get(code)}
    units = {layout.unit} - {""} or profiles.units - {""} or of_codes or {"mm"}
    scale = scale_of(profiles.place, units, "mm")
    xz *= scale
    if unseen.all():
        raise ScanError(f"{profiles.place}: nothing was seen in any profile")
    low, high = np.nanmin(xz, axis=0).round(3), np.nanmax(xz, axis=0).round(3)
    taken["columns"] = f"{profiles.titles}: {low.tolist()} to {high.tolist()} mm"
    taken["unit"] = listed(units)
    words = listed(f"{code:.12g}" for code in codes) or "blank"
    taken["missing"] = f"{words}: {unseen.sum()} of {len(xz)} points"
    least, largest = sorted(np.abs([low, high]).max(axis=0))
    least = least if max(profiles.counts) > 1 else largest  # a point may be at x = 0
    if not 1 <= least <= largest <= FARTHEST_MM:
        off = {
            u: abs(np.log((largest / scale * k + 1e-9) / 150))
            for u, k in LENGTHS.items()
        }
        sentence = f"{largest:.4g} mm in the profiles; expected 1 to {FARTHEST_MM:g}"
        raise Question(
            f"{profiles.place}: {sentence}: the unit, or a code for nothing seen "
            "(--missing)?",
            unit=min(off, key=off.get),
        )
