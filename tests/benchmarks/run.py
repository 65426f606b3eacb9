"""Run the benchmarks: every bench_*.py beside this file, or those named. Prints a table
and writes results/bench.csv.

    python tests/benchmarks/run.py         all but bench_large.py, which takes minutes
    python tests/benchmarks/run.py disk    bench_disk.py; other rows of the table stay

A benchmark offers `rows() -> list[dict]`, as `bench.at_most` makes them.
"""

import importlib
import sys
from pathlib import Path

import pandas as pd

HERE = Path(__file__).parent
OUTPUT = HERE.parents[1] / "results" / "bench.csv"


def find(names: list[str]) -> list[Path]:
    """The benchmark files named, or all that do not take minutes.

    Ends the program with one sentence when a name fits none.
    """
    paths = sorted(HERE.glob("bench_*.py"))
    known = {path.stem.removeprefix("bench_"): path for path in paths}
    unknown = sorted(set(names) - set(known))
    if unknown:
        sys.exit(
            f"no benchmark named {', '.join(unknown)}; there are {', '.join(known)}"
        )
    return [known[name] for name in names or sorted({*known} - {"large"})]


def write(rows: list[dict], output: Path) -> pd.DataFrame:
    """Write the rows; those of other names that an earlier run left are kept."""
    frame = pd.DataFrame(rows)
    if output.exists():
        earlier = pd.read_csv(output)
        frame = pd.concat([earlier[~earlier["name"].isin(frame["name"])], frame])
    output.parent.mkdir(parents=True, exist_ok=True)
    frame.to_csv(output, index=False)
    return frame


def main(names: list[str]) -> int:
    rows = []
    for path in find(names):
        found = importlib.import_module(path.stem).rows()
        print(pd.DataFrame(found).to_string(index=False, float_format="{:.3g}".format))
        rows += found
    write(rows, OUTPUT)
    print(f"Written: {OUTPUT}")
    return 0 if all(row["met"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
