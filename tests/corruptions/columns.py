"""Tables whose columns are missing, twice there, misnamed or of two conventions."""

from corruptions.folder import any_table, corruption, turned
from profilecal.scan.conventions import CONVENTIONS


@corruption
def column_renamed(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    old = str(rng.choice(table.columns))
    folder.put(
        name, table.rename(columns={old: str(rng.choice(["", "X", f" {old} ", old + "_mm", "pose", "x", "qx"]))})
    )


@corruption
def column_dropped(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    folder.put(name, table.drop(columns=rng.choice(table.columns)))


@corruption
def column_doubled(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    column = str(rng.choice(table.columns))
    again = table[column] if rng.uniform() < 0.5 else table[column].sample(frac=1, random_state=1).to_numpy()
    table.insert(int(rng.integers(table.shape[1] + 1)), f"{column}#", again)
    folder.put(name, table.rename(columns={f"{column}#": str(rng.choice([column, column.upper(), f" {column}"]))}))


@corruption
def columns_in_other_order(rng, folder):
    name = any_table(rng)
    table = folder.table(name)
    folder.put(name, table[rng.permutation(table.columns)])


@corruption
def header_missing(rng, folder):
    name = f"{any_table(rng)}.csv"
    folder.files[name] = folder.files[name].split(b"\n", 1)[1]


@corruption
def names_of_columns_exchanged(rng, folder):
    """Only the header line: x for y, qw for qx, a for c."""
    name = any_table(rng)
    table = folder.table(name)
    a, b = rng.choice([c for c in table.columns if c not in ("pose", "side")], 2, replace=False)
    if name == "profiles":  # x for z
        turned(folder, [1, 0, 1])
    folder.put(name, table.rename(columns={a: b, b: a}))


@corruption
def a_second_orientation(rng, folder):
    table = folder.table("poses")
    other = CONVENTIONS[rng.integers(len(CONVENTIONS))]
    for column in other.columns:
        table[column] = rng.uniform(-1, 1, len(table))
    folder.put("poses", table)


@corruption
def other_convention_named(rng, folder):
    """The angles of one convention under the names of another."""
    table, old, _, _ = folder.poses()
    same = [c for c in CONVENTIONS if len(c.columns) == len(old.columns)]
    new = same[rng.integers(len(same))]
    folder.put("poses", table.rename(columns=dict(zip(old.columns, rng.permutation(new.columns), strict=True))))
