"""Run the benchmarks: every bench_*.py beside this file, or those named. Prints a table
and writes results/bench.csv.

    python tests/benchmarks/run.py         all but bench_large.py
    python tests/benchmarks/run.py disk    bench_disk.py; other rows of the table stay

A benchmark offers `rows() -> list[dict]`, as `bench.at_most` makes them.
"""

import importlib
import sys
from pathlib import Path

import pandas as pd

HERE = Path(__file__).parent
OUTPUT = HERE.parents[1] / "results" / "bench.csv"
LONG = "bench_large"  # takes minutes


def main(names: list[str]) -> int:
    modules = [f"bench_{name}" for name in names]
    if not names:
        modules = sorted({path.stem for path in HERE.glob("bench_*.py")} - {LONG})
    rows = []
    for module in modules:
        found = importlib.import_module(module).rows()
        print(pd.DataFrame(found).to_string(index=False, float_format="{:.3g}".format))
        rows += found
    table = pd.DataFrame(rows)
    if OUTPUT.exists():
        earlier = pd.read_csv(OUTPUT)
        table = pd.concat([earlier, table]).drop_duplicates("name", keep="last")
    OUTPUT.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(OUTPUT, index=False)
    print(f"Written: {OUTPUT}")
    return 0 if all(row["met"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
