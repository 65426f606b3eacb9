"""Tables whose columns are twice there or misnamed; numbers that are none, or of the
wrong sign or size.
"""

from functools import wraps

import numpy as np

from corruptions.folder import SLIGHT, any_size, corruption, one, some, turned


def on_table(function):
    """A corruption of the rows of any table: (rng, table, one of its columns of
    numbers, name, folder).
    """

    @wraps(function)
    def change(rng, folder):
        name = str(rng.choice(["poses", "profiles"]))
        table = folder.table(name)
        column = str(rng.choice(numbers_of(table)))
        folder.put(name, function(rng, table, column, name, folder))

    return corruption(change)


def numbers_of(table, *others):
    """The names of columns of numbers, but for some."""
    return [name for name in table.columns if name not in ("pose", "side", *others)]


@on_table
def column_renamed(rng, table, column, *_):
    old = one(rng, ["pose", column])
    new = one(rng, ["", "X", f" {old} ", f"{old}_mm", "pose", "x", "qx"])
    return table.rename(columns={old: new})


@on_table
def column_doubled(rng, table, column, *_):
    again = table[column]
    if rng.uniform() >= 0.5:
        again = again.sample(frac=1, random_state=1).to_numpy()
    table.insert(int(rng.integers(table.shape[1] + 1)), f"{column}#", again)
    title = str(rng.choice([column, column.upper(), f" {column}"]))
    return table.rename(columns={f"{column}#": title})


@on_table
def names_of_columns_exchanged(rng, table, column, name, folder):
    """Only the header line: x for y, qw for qx, a for c."""
    other = str(rng.choice(numbers_of(table, column)))
    if name == "profiles":  # x for z
        turned(folder, [1, 0, 1])
    return table.rename(columns={column: other, other: column})


CELLS = (
    *(np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 0, 9999.99, -32768, 1e9),
    *("text", "", "NA", "1,5", "None", "1.5 mm"),
)


@on_table
def cells_replaced(rng, table, *_):
    table = table.astype(object)
    for row in some(rng, len(table), 1, 20):
        cell = one(rng, CELLS)
        table.iat[row, rng.integers(table.shape[1])] = cell
    return table


@on_table
def a_column_negated(rng, table, column, name, folder):
    if name == "profiles":
        turned(folder, [0, 0, 1] if column == "x" else [1, 0, 0])
    return table.assign(**{column: -table[column]})


@on_table
def a_column_scaled(rng, table, column, *_):
    of_units = 1000, 0.001, 10, 0.1, 25.4, 180 / np.pi, np.pi / 180
    factor = one(rng, [*of_units, 1 + any_size(rng, SLIGHT, 0.1)])
    return table.assign(**{column: table[column] * factor})


@on_table
def labels_permuted(rng, table, *_):
    old = table["pose"].unique()
    new = np.roll(old, rng.choice([1, -1, 2]))
    rows = some(rng, len(old), 2, len(old))
    if rng.uniform() < 0.5:
        new = old.copy()
        new[rows] = old[rng.permutation(rows)]
    return table.assign(pose=table["pose"].map(dict(zip(old, new, strict=True))))
