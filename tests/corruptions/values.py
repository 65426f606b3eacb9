"""Numbers in tables that are no numbers, of the wrong sign or size, or coarse."""

import numpy as np

from corruptions.folder import SLIGHT, any_size, any_table, corruption, some, turned


@corruption
def cells_replaced(rng, folder):
    name = any_table(rng)
    table = folder.table(name).astype(object)
    nasty = (
        np.nan,
        np.inf,
        -np.inf,
        1e308,
        -1e308,
        1e-320,
        "text",
        "",
        0,
        9999.99,
        -32768,
        1e9,
        "NA",
        "1,5",
        "None",
        "1.5 mm",
    )
    for i in some(rng, len(table), 1, 20):
        table.iat[i, rng.integers(table.shape[1])] = nasty[rng.integers(len(nasty))]
    folder.put(name, table)


@corruption
def cells_negated(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    columns = [c for c in table.columns if c not in ("pose", "side")]
    for i in some(rng, len(table)):
        column = rng.choice(columns)
        table.loc[i, column] = -table.loc[i, column]
    folder.put(name, table)


@corruption
def a_column_negated(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    column = str(rng.choice([c for c in table.columns if c not in ("pose", "side")]))
    if name == "profiles":
        turned(folder, [0, 0, 1] if column == "x" else [1, 0, 0])
    folder.put(name, table.assign(**{column: -table[column]}))


@corruption
def a_column_scaled(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    column = str(rng.choice([c for c in table.columns if c not in ("pose", "side")]))
    factor = [1000, 0.001, 10, 0.1, 25.4, 180 / np.pi, np.pi / 180, 1 + any_size(rng, SLIGHT, 0.1)][rng.integers(8)]
    folder.put(name, table.assign(**{column: table[column] * factor}))


@corruption
def a_column_constant(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    column = str(rng.choice([c for c in table.columns if c not in ("pose", "side")]))
    folder.put(name, table.assign(**{column: [0.0, 1.0, table[column][0]][rng.integers(3)]}))


@corruption
def digits_lost(rng, folder):
    """Values printed coarsely."""
    name = any_table(rng)
    table = folder.table(name)
    columns = [c for c in table.columns if c not in ("pose", "side")]
    folder.put(name, table.assign(**table[columns].round(int(rng.integers(-1, 3)))))
