"""Does the truth lie in the stated regions, whatever the robot does? One table, one row
a cell.

    python tests/benchmarks/bench_uncertainty.py                   all cells, 300 scans
    each: hours
    python tests/benchmarks/bench_uncertainty.py --scans 20 plane  cells whose name
    contains "plane"
    python tests/benchmarks/bench_uncertainty.py --list            the cells' names

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

from profilecal.calibration.calibration import calibrate
from profilecal.geometry.noise import Noise
from profilecal.simulation.robot import Robot
from profilecal.simulation.spec import WIDE, Spec, record, scene_of, taken
from profilecal.targets import TARGETS

OUTPUT = Path(__file__).parents[2] / "results" / "uncertainty.csv"
KINDS = ("edge", "disk", "ball", "plane", "rod")
BESIDE = {
    "edge": "plane",
    "disk": "edge",
    "ball": "edge",
    "plane": "edge",
    "rod": "plane",
}  # the second target
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
        noise = Noise(profile_mm=PROFILE_MM, **self.robot_noise)
        entries = {
            "groups": 10,
            "positions": 3,
            "scanner": replace(WIDE, points=400),
        } | self.entries
        raw = {"measured": "profiles"} if seed % 2 else {}
        specs = [
            Spec(kind=kind, seed=seed, noise=noise, **raw, **entries)
            for kind in self.kinds
        ]
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
        placed = target.at(
            scene.target.frame[0], scene.facing @ target.stance, target.sizes
        )
        scans.append(record(replace(scene, target=placed), poses, spec, rng))
    return scans


def cells() -> dict[str, Cell]:
    """All cells by name."""
    found = {}
    for kind in KINDS:
        found[f"{kind}, no robot error"] = Cell((kind,))
        for situation, (errors, entries) in SITUATIONS.items():
            kinds = (kind, BESIDE[kind]) if situation == "two targets" else (kind,)
            for statement, share in STATEMENTS.items():
                stated = {
                    name: share * value for name, value in errors.items() if share
                }
                found[f"{kind}, {situation}, {statement}"] = Cell(
                    kinds, errors, stated, entries
                )
    for kind, poses in FEW:
        few = {"groups": poses, "positions": 1}
        found[f"{kind}, {poses} poses, unstated"] = Cell(
            (kind,), BOTH, {}, few, total=True
        )
    for kind in KINDS:
        found[f"{kind}, shared by 10 orientations, unstated"] = Cell((kind,), SHARED)
        for arm, (robot, accuracy) in ARMS.items():
            for statement, stated in (("unstated", {}), ("accuracy stated", accuracy)):
                found[f"{kind}, {arm}, {statement}"] = Cell(
                    (kind,), {}, stated, {"robot": robot}, total=True
                )
    return found


# One scan


def version_of_library() -> str:
    """A hash of the library's modules that this script imports, and of the script."""
    modules = [
        module
        for name, module in sys.modules.items()
        if name.split(".")[0] == "profilecal"
    ]
    source = b"".join(
        Path(path).read_bytes()
        for path in sorted([__file__, *(m.__file__ for m in modules)])
    )
    return sha256(source).hexdigest()[:8]


def measure(cell: Cell, seed: int) -> dict:
    """What calibrating a cell's scans of one seed gives; an exception counts as a
    status of its own.
    """
    scans, start = cell.scans(seed), time.process_time()
    try:
        found = calibrate(scans).to_json()
    except Exception as error:  # a broken cell must not end a run of hours
        found = {"status": "error", "messages": [f"{type(error).__name__}: {error}"]}
    used, rejected = (
        len(found.get(name, ())) for name in ("poses_used", "poses_rejected")
    )
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
    version, rows = version_of_library(), []
    if OUTPUT.exists():
        known = pd.read_csv(OUTPUT, dtype={"version": str})
        known = known[
            (known["version"] == version)
            & known["cell"].isin(chosen)
            & (known["seed"] < scans)
        ]
        rows = known.to_dict("records")
    there = {(row["cell"], row["seed"]) for row in rows}
    missing = [
        (name, seed)
        for seed in range(scans)
        for name in chosen
        if (name, seed) not in there
    ]
    OUTPUT.parent.mkdir(parents=True, exist_ok=True)
    # for the workers, which start afresh
    os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
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


def summary(rows: pd.DataFrame, chosen: dict[str, Cell]) -> pd.DataFrame:
    """One row a cell: how many scans say `ok` and how many reject good poses; of the
    answers that say `ok` the mean squared error, the share inside the 95 % region and
    the largest; the mean of all answers. `off` says what is beyond MEAN and INSIDE and
    beyond chance.
    """
    found = {}
    for name, cell in chosen.items():
        of = rows[rows["cell"] == name]
        squares = of["square_total" if cell.total else "square"].astype(float)
        good = squares[of["status"] == "ok"].dropna()
        found[name] = {
            "scans": len(of),
            "ok": (of["status"] == "ok").mean(),
            "rejecting": (of["rejected"] > 0).mean(),
            "against": "total" if cell.total else "covariance",
            "mean": good.mean(),
            "inside": (good < LIMIT).mean(),
            "largest": good.max(),
            "mean of all": squares.mean(),
            "off": off(good) if len(good) else "",
            "seconds": of["seconds"].mean(),
        }
    return pd.DataFrame.from_dict(found, orient="index")


def by_chance(n: int):
    """Where the mean of n squared errors and their share inside the 95 % region are, by
    chance: their sum follows χ² of 6 n degrees of freedom, the number inside a binomial
    law.
    """
    return (
        np.divide(law, n)
        for law in (
            chi2.interval(1 - CHANCE, 6 * n),
            binom.interval(1 - CHANCE, n, 0.95),
        )
    )


def off(squares) -> str:
    """What speaks against the stated regions: the mean or the share inside, where
    neither bounds nor chance hold it.
    """
    values = {"mean": squares.mean(), "inside": (squares < LIMIT).mean()}
    bounds = zip((MEAN, INSIDE), by_chance(len(squares)), strict=True)
    return ", ".join(
        name
        for (name, value), ((low, high), (least, most)) in zip(
            values.items(), bounds, strict=True
        )
        if not min(low, least) <= value <= max(high, most)
    )


def show(found: pd.DataFrame) -> str:
    """The summary as text, and where good cells are by chance."""
    scans = int(found["scans"].max())
    (low, high), (fewest, most) = by_chance(scans)
    return (
        found.to_string(float_format="{:.3g}".format, na_rep="")
        + f"\nexpected       mean {MEAN[0]}-{MEAN[1]}, inside {INSIDE[0]:.0%}-{INSIDE[1]:.0%}; "
        + f"{scans} scans of a good cell give {low:.3g}-{high:.3g} and {fewest:.1%}-{most:.1%}, but for {CHANCE:.0%}"
    )


def rows() -> list[dict]:
    """For `run.py`: CPU seconds of one calibration with robot errors that nobody
    stated.
    """
    some = {
        name: cell for name, cell in cells().items() if name.endswith("both, unstated")
    }
    means = {
        name: np.mean([measure(cell, seed)["seconds"] for seed in range(4)])
        for name, cell in some.items()
    }
    return [
        at_most(1, f"uncertainty: {name}, 10 x 3", mean, "two seconds", 2.0)
        for name, mean in means.items()
    ]


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
    chosen = {
        n: cell
        for n, cell in cells().items()
        if not given.part or any(part in n for part in given.part)
    }
    if given.list:
        print("\n".join(chosen))
        return 0
    found = table(chosen, given.scans, given.workers)
    print(show(found))
    return int((found["off"] != "").any())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
