"""Every notebook executed, and what they hand out gathered under one folder with the scorecard."""

import json
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from profilecal.papers import scorecard
from profilecal.running import notebooks
from profilecal.scan.files import remove

OWNED = ("notebooks", "figures", "tables", "scorecard.csv", "scorecard.md")


def start_clean(output: Path) -> None:
    """Make `output` hold nothing of an earlier run, and nothing but that is removed.

    Raises ValueError when what is in the way was not written by an earlier run.
    """
    marker = output / "run.json"
    in_the_way = [output / name for name in OWNED if (output / name).exists()]
    if in_the_way and not marker.exists():
        raise ValueError(f"{in_the_way[0]} was not written by this command; name a new or empty folder")
    for path in in_the_way:
        remove(path)
    for name in OWNED[:3]:
        (output / name).mkdir(parents=True)


def reproduce(paths: list[Path], given: dict, output: Path) -> tuple[pd.DataFrame, dict[str, str]]:
    """Execute notebooks in parallel and gather their scorecards; return it and, by name, why some failed.

    A notebook that declares `executed_dir` reads the others' results and runs after them.
    """
    output = output.resolve()
    declared = {path: notebooks.parameters_of(path) for path in paths}
    notebooks.check_parameters(declared, given)
    values = {"results_dir": str(output), "executed_dir": str(output / "notebooks")} | given
    parameters = {path: {k: v for k, v in values.items() if k in declared[path]} for path in paths}
    readers = [path for path in paths if "executed_dir" in declared[path]]
    start_clean(output)
    (output / "run.json").write_text(json.dumps({"notebooks": [path.stem for path in paths], "parameters": given}))

    failed = {}
    total = sum(notebooks.count_cells(path) + bool(parameters[path]) for path in paths)  # parameters take a cell
    with tqdm(total=total, unit="cell", disable=None, bar_format="{l_bar}{bar}| {n}/{total} cells {elapsed}") as bar:

        def execute(path: Path) -> float:
            start = time.perf_counter()
            notebooks.run(path, output / "notebooks" / path.name, parameters[path], bar.update, keep=True)
            return time.perf_counter() - start

        for group in ([path for path in paths if path not in readers], readers):
            with ThreadPoolExecutor(max_workers=notebooks.cores()) as pool:
                runs = {pool.submit(execute, path): path.stem for path in group}
                try:
                    for run in as_completed(runs):
                        try:
                            bar.write(f"  {runs[run]}: {run.result():.1f} s")
                        except notebooks.NotebookError as error:
                            failed[runs[run]] = str(error)
                            bar.write(f"  {runs[run]}: FAILED")
                except BaseException:
                    pool.shutdown(wait=False, cancel_futures=True)
                    notebooks.stop_all()
                    raise
    notebooks.stop_idle()

    gathered = scorecard.gather(output / "notebooks")
    scorecard.write(gathered, output)
    return gathered, failed
