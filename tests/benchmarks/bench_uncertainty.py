"""Does the truth lie in the stated regions, whatever the robot does?

One table, one row a cell.

    python tests/benchmarks/bench_uncertainty.py
        all cells, 300 scans each: hours
    python tests/benchmarks/bench_uncertainty.py --scans 20 plane
        cells whose name contains "plane"
    python tests/benchmarks/bench_uncertainty.py --list
        the cells' names

A cell is a target, a robot, and what the scan says of the robot. Every scan is
simulated, calibrated, and its answer compared with the truth: the squared error over
the stated covariance, 6 expected, below 12.59 in 95 % of all scans. What is found goes
to results/uncertainty.csv at once; a later run with the same calibration goes on from
there.

As a benchmark (`run.py uncertainty`) it tells what a calibration takes.
"""

import argparse
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from bench import at_most
from scipy.stats import binom, chi2
from simulated import EXACT_SCANNER, printed_square
from tqdm import tqdm

import profilecal as pc
from profilecal.geometry.noise import Noise
from profilecal.simulation.robot import Robot
from profilecal.simulation.spec import WIDE, Spec, record, scene_of, taken
from profilecal.targets import TARGETS

OUTPUT = Path(__file__).parents[2] / "results" / "uncertainty.csv"
KINDS = ("edge", "disk", "ball", "plane", "rod")
# the second target
BESIDE = {
    "edge": "plane",
    "disk": "edge",
    "ball": "edge",
    "plane": "edge",
    "rod": "plane",
}
PROFILE_MM = 0.05
BOTH = {"position_mm": 0.05, "orientation_deg": 0.02}
SHARED = {"group_position_mm": 0.05, "group_orientation_deg": 0.01}
SITUATIONS = {  # the robot's errors, and what else there is to say of the scan
    "position": ({"position_mm": 0.05}, {}),
    "orientation": ({"orientation_deg": 0.02}, {}),
    "both": (BOTH, {}),
    "five repeats": (BOTH, {"repeats": 5, "positions": 2}),
    "two targets": (BOTH, {}),
    "shared by orientation": (SHARED, {"groups": 16, "positions": 2}),
}
STATEMENTS = {"stated": 1.0, "unstated": 0.0, "stated a fifth": 0.2}
FEW = (("plane", 6), ("plane", 8), ("edge", 6), ("disk", 4), ("ball", 5), ("ball", 7))
ARMS = {  # with the accuracy that notebook 43 finds for such an arm
    "joints 0.02 deg": (
        Robot(joint_deg=0.02),
        {"accuracy_mm": 0.037, "accuracy_deg": 0.021},
    ),
    "links 0.2 mm": (Robot(link_mm=0.2), {"accuracy_mm": 0.27, "accuracy_deg": 0.016}),
}
# where a cell is to be, as far as chance allows
MEAN, INSIDE = (5.4, 6.6), (0.93, 0.97)
CHANCE = 0.01  # that a good cell is flagged for one of them
LIMIT = float(chi2.ppf(0.95, 6))


@dataclass(frozen=True)
class Cell:
    """Scans of one sort, of which the seed alone differs."""

    kinds: tuple[str, ...]
    robot_noise: dict = field(default_factory=dict)
    stated: dict = field(default_factory=dict)  # of the robot, in scan.toml
    entries: dict = field(default_factory=dict)  # of the specification
    # it is `covariance_total` that is to hold: residuals cannot show what the robot
    # does
    total: bool = False

    def scans(self, seed: int) -> list:
        """A cell's scans of one seed: for one in two raw profiles, as far as there are
        tables for the others.
        """
        scanner = replace(WIDE, points=400)
        noise = Noise(profile_mm=PROFILE_MM, **self.robot_noise)
        entries = {"groups": 10, "positions": 3, "scanner": scanner} | self.entries
        if seed % 2:
            entries["measured"] = "profiles"
        specs = [Spec(kind, seed=seed, noise=noise, **entries) for kind in self.kinds]
        stated = {"profile_mm": PROFILE_MM} | EXACT_SCANNER | self.stated
        return [replace(scan, noise=stated) for scan in scans_of(*specs)]


def scans_of(first: Spec, *others: Spec) -> list:
    """Scans of targets that stand in the same place one after the other, where the
    robot errs alike.
    """
    rng = np.random.default_rng(first.seed)
    scene = scene_of(first, rng)
    poses = taken(scene, first, rng)
    scans = [record(scene, poses, first, rng)]
    for spec in others:
        target = TARGETS[spec.kind]
        origin, axes = scene.target.frame[0], scene.facing @ target.stance
        placed = target.at(origin, axes, target.sizes)
        scans.append(record(replace(scene, target=placed), poses, spec, rng))
    return scans


def cells() -> dict[str, Cell]:
    """All cells by name."""
    every = {}
    for kind in KINDS:
        every |= cells_of_situations(kind)
    for kind, poses in FEW:
        few = {"groups": poses, "positions": 1}
        cell = Cell((kind,), BOTH, {}, few, total=True)
        every[f"{kind}, {poses} poses, unstated"] = cell
    for kind in KINDS:
        every |= cells_of_hidden_errors(kind)
    return every


def cells_of_situations(kind: str) -> dict[str, Cell]:
    """What a target's residuals can show of the robot."""
    every = {f"{kind}, no robot error": Cell((kind,))}
    for situation, (errors, entries) in SITUATIONS.items():
        kinds = (kind, BESIDE[kind]) if situation == "two targets" else (kind,)
        for statement, share in STATEMENTS.items():
            stated = {name: share * value for name, value in errors.items() if share}
            cell = Cell(kinds, errors, stated, entries)
            every[f"{kind}, {situation}, {statement}"] = cell
    return every


def cells_of_hidden_errors(kind: str) -> dict[str, Cell]:
    """What they cannot show, or hardly."""
    every = {f"{kind}, shared by 10 orientations, unstated": Cell((kind,), SHARED)}
    for arm, (robot, accuracy) in ARMS.items():
        for statement, stated in (("unstated", {}), ("accuracy stated", accuracy)):
            cell = Cell((kind,), {}, stated, {"robot": robot}, total=True)
            every[f"{kind}, {arm}, {statement}"] = cell
    return every


# One scan


def version_of_library() -> str:
    """A hash of the library's modules that this script imports, and of the script."""
    paths = [
        module.__file__
        for name, module in sys.modules.items()
        if name.split(".")[0] == "profilecal"
    ]
    source = b"".join(Path(path).read_bytes() for path in sorted([__file__, *paths]))
    return sha256(source).hexdigest()[:8]


def measure(cell: Cell, seed: int) -> dict:
    """What calibrating a cell's scans of one seed gives; an exception counts as a
    status of its own.
    """
    scans = cell.scans(seed)
    start = time.process_time()
    try:
        found = pc.calibrate(scans).to_json()
    except Exception as error:  # a broken cell must not end a run of hours
        found = {"status": "error", "messages": [f"{type(error).__name__}: {error}"]}
    used = len(found.get("poses_used", ()))
    rejected = len(found.get("poses_rejected", ()))
    return {
        "status": found["status"],
        "square": printed_square(found, scans[0].truth),
        "square_total": printed_square(found, scans[0].truth, "covariance_total"),
        "used": used,
        "rejected": rejected,
        "missed": sum(len(scan.labels) for scan in scans) - used - rejected,
        "seconds": time.process_time() - start,
        "why": " | ".join(found["messages"]) if found["status"] != "ok" else "",
    }


# All of them


def table(chosen: dict[str, Cell], scans: int, workers: int) -> pd.DataFrame:
    """The summary of `scans` scans of each of the cells; those of the same calibration
    in OUTPUT are part of it.
    """
    version = version_of_library()
    rows = known_rows(version, chosen, scans)
    done = {(row["cell"], row["seed"]) for row in rows}
    wanted = [(name, seed) for seed in range(scans) for name in chosen]
    missing = [job for job in wanted if job not in done]
    OUTPUT.parent.mkdir(parents=True, exist_ok=True)
    # for the workers, which start afresh
    os.environ["OMP_NUM_THREADS"] = "1"
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = {
            pool.submit(measure, chosen[name], seed): (name, seed)
            for name, seed in missing
        }
        for job in tqdm(as_completed(jobs), total=len(jobs), unit="scan"):
            name, seed = jobs[job]
            rows.append({"version": version, "cell": name, "seed": seed} | job.result())
            pd.DataFrame(rows[-1:]).to_csv(
                OUTPUT, mode="a", index=False, header=not OUTPUT.exists()
            )
    return summary(pd.DataFrame(rows), chosen)


def known_rows(version: str, chosen: dict[str, Cell], scans: int) -> list[dict]:
    """What OUTPUT has of these cells by the same calibration."""
    if not OUTPUT.exists():
        return []
    known = pd.read_csv(OUTPUT, dtype={"version": str})
    known = known[known["version"] == version]
    known = known[known["cell"].isin(chosen) & (known["seed"] < scans)]
    return known.to_dict("records")


def summary(rows: pd.DataFrame, chosen: dict[str, Cell]) -> pd.DataFrame:
    """One row a cell: how many scans say `ok` and how many reject good poses.

    Then of the answers that say `ok` the mean squared error, the share inside the 95 %
    region and the largest; the mean of all answers. `off` says what is beyond MEAN and
    INSIDE and beyond chance.
    """
    summaries = {}
    for name, cell in chosen.items():
        of_cell = rows[rows["cell"] == name]
        ok = of_cell["status"] == "ok"
        squares = of_cell["square_total" if cell.total else "square"].astype(float)
        good = squares[ok].dropna()
        summaries[name] = {
            "scans": len(of_cell),
            "ok": ok.mean(),
            "rejecting": (of_cell["rejected"] > 0).mean(),
            "against": "total" if cell.total else "covariance",
            "mean": good.mean(),
            "inside": (good < LIMIT).mean(),
            "largest": good.max(),
            "mean of all": squares.mean(),
            "off": off(good) if len(good) else "",
            "seconds": of_cell["seconds"].mean(),
        }
    return pd.DataFrame.from_dict(summaries, orient="index")


def by_chance(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the mean of n squared errors and their share inside the 95 % region are, by
    chance.

    Their sum follows χ² of 6 n degrees of freedom, the number inside a binomial law.
    """
    sums = chi2.interval(1 - CHANCE, 6 * n)
    numbers_inside = binom.interval(1 - CHANCE, n, 0.95)
    return np.divide(sums, n), np.divide(numbers_inside, n)


def off(squares: pd.Series) -> str:
    """What speaks against the stated regions: the mean or the share inside, where
    neither bounds nor chance hold it.
    """
    mean_by_chance, inside_by_chance = by_chance(len(squares))
    values = {
        "mean": (squares.mean(), [*MEAN, *mean_by_chance]),
        "inside": ((squares < LIMIT).mean(), [*INSIDE, *inside_by_chance]),
    }
    return ", ".join(
        name
        for name, (value, bounds) in values.items()
        if not min(bounds) <= value <= max(bounds)
    )


def show(summaries: pd.DataFrame) -> str:
    """The summary as text, and where good cells are by chance."""
    scans = int(summaries["scans"].max())
    (low, high), (fewest, most) = by_chance(scans)
    return (
        summaries.to_string(float_format="{:.3g}".format, na_rep="")
        + f"\nexpected       mean {MEAN[0]}-{MEAN[1]}, "
        + f"inside {INSIDE[0]:.0%}-{INSIDE[1]:.0%}; "
        + f"{scans} scans of a good cell give {low:.3g}-{high:.3g} "
        + f"and {fewest:.1%}-{most:.1%}, but for {CHANCE:.0%}"
    )


def rows() -> list[dict]:
    """For `run.py`: CPU seconds of one calibration with robot errors that nobody
    stated.
    """
    lines = []
    for name, cell in cells().items():
        if name.endswith("both, unstated"):
            mean = np.mean([measure(cell, seed)["seconds"] for seed in range(4)])
            name = f"uncertainty: {name}, 10 x 3"
            lines.append(at_most(1, name, mean, "two seconds", 2.0))
    return lines


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "part", nargs="*", help="only cells whose name contains one of these"
    )
    parser.add_argument("--scans", type=int, default=300, help="of a cell (300)")
    parser.add_argument(
        "--workers",
        type=int,
        default=os.cpu_count(),
        help="processes (one for each core)",
    )
    parser.add_argument(
        "--list", action="store_true", help="the cells' names and no more"
    )
    given = parser.parse_args(arguments)
    parts = given.part or [""]
    chosen = {
        name: cell
        for name, cell in cells().items()
        if any(part in name for part in parts)
    }
    if given.list:
        print("\n".join(chosen))
        return 0
    summaries = table(chosen, given.scans, given.workers)
    print(show(summaries))
    return int((summaries["off"] != "").any())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
