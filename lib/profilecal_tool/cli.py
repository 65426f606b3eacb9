"""The command line, which is thin.

Wrong input ends with status 2 and one sentence, a failed notebook with status 1.
"""

import os
import shlex
import signal
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path

import click
from click import argument, echo, option

import profilecal as pc
from profilecal_tool.controllers import CONTROLLERS, for_controller

# what cannot be read, read_scan says in one sentence
SCAN = click.Path(path_type=Path, readable=False)
PLACE = click.Path(path_type=Path)
COUNT = click.IntRange(1)
MOUNT = click.Choice(["eye-in-hand", "eye-to-hand"])


def writing(name, words, *endings):
    """An option that takes a place where a file of such an ending can be written."""

    def checked(ctx, param, path):
        if path and path.suffix.lower() not in endings:
            raise ValueError(
                f"{name} is {path}; expected a name that ends in {' or '.join(endings)}"
            )
        if path and (path.is_dir() or not os.access(f"{path.parent}/", os.W_OK)):
            raise ValueError(f"{path}: no file can be written there")
        return path

    return option(name, type=PLACE, callback=checked, help=words)


def taking(name, metavar, words, kind=str):
    """An option that takes a value for each word of `metavar`."""
    count = len(metavar.split())
    return option(name, nargs=count, type=kind, metavar=metavar, help=words)


FOLDER = argument("folder", type=SCAN)
ANSWER = option(
    "--with", "answer", required=True, type=SCAN, help="What calibrate --json printed."
)
CLOUD = writing("--cloud", "Write all profiles put together to this PLY file.", ".ply")


class Commands(click.Group):
    """Commands that say in one sentence what is wrong with their input."""

    def invoke(self, ctx):
        """Carry out a command; wrong input ends it with status 2."""
        try:
            with interruptible("Nothing was written."):
                return super().invoke(ctx)
        except BrokenPipeError:
            raise  # nobody reads on: click ends quietly
        except MemoryError:
            end("more than the memory holds: thin it out")
        except OSError as error:
            named = error.filename and f"{error.filename}: {error.strerror}"
            end(named or error)
        except ValueError as error:
            end(error)


def end(sentence, status=2):
    """Say why it ends, with a status."""
    echo(f"profilecal: {sentence}", err=True)
    raise SystemExit(status)


@contextmanager
def interruptible(sentence: str) -> Iterator[None]:
    """Ctrl-C, `kill` and `timeout` end here, after everything is cleaned up.

    They end with a sentence and with status 130.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    except KeyboardInterrupt:
        echo(f"\nInterrupted. {sentence}", err=True)
        raise SystemExit(130) from None


@contextmanager
def working(doing: str) -> Iterator[None]:
    """Say on a terminal what is being done, and how far what takes long is."""
    from tqdm import tqdm

    from profilecal.geometry.progress import watcher

    on_terminal = {"disable": None, "leave": False}

    token = watcher.set(partial(tqdm, delay=2, **on_terminal))
    try:
        with tqdm(desc=doing, bar_format="{desc} …", **on_terminal):
            yield
    finally:
        watcher.reset(token)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="profilecal")
def main():
    """Hand-eye calibration of 2D laser profile scanners on robots."""
    # Before NumPy loads: more threads gain nothing here, and wait for each other.
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


@main.command()
@argument("folders", nargs=-1, required=True, type=SCAN)
@option(
    "--json", "as_json", is_flag=True, help="Print one JSON object instead of a table."
)
@option(
    "--to",
    "vendor",
    metavar="NAME",
    type=click.Choice(CONTROLLERS),
    help=f"{', '.join(CONTROLLERS)}: a pose to paste.",
)
@taking(
    "--guess",
    "X Y Z W P R",
    "Where the sensor is believed to be, mm and degrees.",
    float,
)
@taking(
    "--guess-sd",
    "MM DEG",
    "How good the guess is, one standard deviation; 15 8 if nothing states it.",
    float,
)
@option(
    "--self-test",
    type=click.IntRange(10),
    metavar="N",
    help="Simulate so many scans from the answer: do its uncertainties hold?",
)
@writing("--report", "Write a report with pictures to this HTML file.", ".html", ".htm")
@CLOUD
def calibrate(folders, as_json, vendor, guess, guess_sd, self_test, report, cloud):
    """Find the sensor pose from scan folders of one sensor."""
    if vendor and as_json:
        raise ValueError(
            "--json prints one JSON object and nothing else; ask for --to without it"
        )
    if report:
        from profilecal_tool.report.page import check_report

        check_report()
    from profilecal.scan.folder import mount_pose

    with working("calibrating"):
        scans = [pc.read_scan(folder) for folder in folders]
        mount = guess and mount_pose(guess, Path("--guess"))
        found = pc.calibrate(scans, mount, guess_sd)
    with interruptible("Above is what was found until then."):
        try:
            found = with_notes(found, folders[0], self_test)
        finally:
            print_calibration(found, as_json, vendor)
    if not as_json:
        echo(next_step(found, folders))
    if report:
        write_the_report(
            folders, report, guess=list(guess or []), guess_sd=list(guess_sd or [])
        )
    if found.is_known:
        put_together(found, found.pose, cloud)
    raise SystemExit(0 if found.is_known else 3)


def with_notes(found, folder, count):
    """A calibration that also says what so many simulated scans do, and, where it is
    weak, which poses would help.
    """
    from dataclasses import replace

    notes = list(found.messages)
    if count and found.is_known:
        with working("testing"):
            notes.append(pc.self_test(found, count).sentence)
    if found.status == "weak":
        from profilecal_tool.plan.task import next_poses

        with working("planning further poses"):
            notes += next_poses(found, folder)
    return replace(found, messages=tuple(notes))


def print_calibration(found, as_json, vendor) -> None:
    """Print a calibration as JSON or in words, with its pose for a controller."""
    from profilecal.calibration.calibration import answer_text
    from profilecal_tool.words import calibration_text

    to_paste = ""
    if vendor and found.is_known:
        to_paste = for_controller(vendor, found.pose, found.frame)
    echo(answer_text(found) if as_json else calibration_text(found, to_paste))
    if vendor and found.status != "ok":
        pose = "this pose is not to be relied on" if to_paste else "no pose to paste"
        echo(f"profilecal: {pose}: see the notes", err=True)


def next_step(found, folders) -> str:
    """What to do after an answer, in a line."""
    if found.status != "ok":
        return "next: do what the notes say, and calibrate again"
    keep = f"profilecal calibrate {' '.join(map(str, folders))} --json > T.json"
    return f"next: {keep}, then profilecal verify or check-mount SCAN --with T.json"


def write_the_report(folders, path, **parameters) -> None:
    """Write the report on some scan folders; status 1 where it fails."""
    from profilecal_pages.notebooks import NotebookError
    from profilecal_tool.report.page import write_report

    try:
        with interruptible(f"{path} was not written."):
            write_report(folders, path, **parameters)
    except (NotebookError, OSError) as error:
        end(f"no report: {error}", 1)
    echo(f"Report: {path}", err=True)


def put_together(found, pose, path) -> None:
    """Write what was seen from all poses, as a sensor pose has it."""
    if path:
        from profilecal_tool.report.cloud import write_cloud

        write_cloud(found, pose, path)
        echo(f"Cloud: {path}", err=True)


@main.command()
@FOLDER
def check(folder):
    """Say what a scan FOLDER holds, before any calibration.

    Poses, groups, noise, motions.
    """
    from profilecal_tool.checking import check

    with working("checking"):
        lines = check(pc.read_scan(folder))
    has_notes = any(line.startswith("note ") for line in lines)
    first = "mind the notes, then " if has_notes else ""
    echo("\n".join([*lines, f"next: {first}profilecal calibrate {folder}"]))


@main.command()
@argument("other", metavar="FOLDER|T2.json", type=PLACE)
@ANSWER
@CLOUD
def verify(other, answer, cloud):
    """Compare an answer with another scan or another answer.

    The scan in FOLDER must not be one that T.json was found from. Status 1 if they
    contradict each other, 2 if FOLDER cannot tell.
    """
    from profilecal_tool.words import verification_text

    with working("verifying"):
        read = pc.read_answer if other.suffix == ".json" else pc.read_scan
        other, answer = read(other), pc.read_answer(answer)
        verification = pc.verify(answer, other)
    echo(verification_text(verification, answer))
    if read is pc.read_scan:
        put_together(verification.other, answer.pose, cloud)
    end_as(verification)


@main.command("check-mount")
@FOLDER
@ANSWER
@writing("--log", "A CSV file to add a row to, and its picture beside.", ".csv")
def check_mount(folder, answer, log):
    """Has anything moved since T.json? A few poses tell.

    FOLDER is a scan of the calibration's target where it stood then; one to three poses
    are enough. Status 1 if anything has moved, 2 if FOLDER cannot tell.
    """
    from profilecal_tool.words import mount_check_text

    answer, scan = pc.read_answer(answer), pc.read_scan(folder)
    check = pc.check_mount(answer, scan)
    echo(mount_check_text(check, scan.kind))
    if log:
        from profilecal_tool.report.log import add_to_log

        echo(f"log            {log}, drawn in {add_to_log(check, folder, log)}")
    end_as(check)


def end_as(check) -> None:
    """End with the status of a check: 0 as expected, 1 if not, 2 if it cannot tell."""
    if not check.as_expected:
        raise SystemExit(1)
    raise SystemExit(0 if check.is_conclusive else 2)


@main.command()
@argument("spec", type=PLACE)
@argument("folder", type=PLACE)
@option(
    "--scan",
    type=COUNT,
    help="Another scan of the same scanner, target and robot: 2, 3, …",
)
def simulate(spec, folder, scan):
    """Write the scan that SPEC.toml describes into a new FOLDER.

    Its truth is in truth.toml.
    """
    from profilecal.scan.toml import read_toml
    from profilecal.simulation.spec import simulate_scan
    from profilecal_tool.plan.specification import read_specification

    entries = read_toml(spec) | ({"scan": scan} if scan else {})
    pc.write_scan(simulate_scan(read_specification(entries, spec)), folder)
    echo(f"{folder}/ written; its truth is in truth.toml")
    after = f"profilecal check-mount {folder} --with T.json, or verify"
    if not scan:
        after = f"profilecal check {folder}, profilecal calibrate {folder}"
    echo(f"next: {after}")


@main.command()
@argument("spec", type=PLACE)
@argument("folder", required=False, type=PLACE)
@option(
    "--poses",
    type=click.IntRange(1, 1000),
    help="So many; else as many as --until takes.",
)
@taking("--until", "MM DEG", "Largest standard deviations in any direction.", float)
@option(
    "--within",
    metavar="SPEC.toml",
    type=PLACE,
    help="After a scan: its [plan] says where the robot may go.",
)
@option(
    "--of",
    "given",
    type=SCAN,
    metavar="POSES",
    help="Predict these instead: a CSV file, a scan folder.",
)
def plan(spec, folder, poses, until, within, given):
    """Choose the best poses for what SPEC.toml describes.

    They go into a new FOLDER, ready to run. SPEC may be a scan folder: its answer says
    where everything is.
    """
    from profilecal.scan.tables import new_folder
    from profilecal_tool.plan import words
    from profilecal_tool.plan.task import read_task

    if given and (folder or poses or until):
        raise ValueError(
            "--of predicts the given poses and writes nothing; "
            "leave FOLDER, --poses and --until out"
        )
    written = new_folder(folder) if folder else nullcontext()
    with working("planning"), written as partial:
        task = read_task(spec, poses, until, within)
        designed = task.plan_of(given) if given else task.plan()
        if partial:
            from profilecal_tool.report.pictures import save_plan

            task.write(designed, partial)
            save_plan(designed, partial / "plan.png")
    lines = words.plan_lines(designed, given or task.count_given)
    if not given:
        lines += words.steps(designed, spec, folder)
    echo("\n".join(lines))


@main.command("import")
@argument("files", metavar="DIR", type=PLACE)
@argument("folder", type=PLACE)
@taking("--target", "KIND", "An edge, disk, ball, plane, rod or point.")
@taking("--radius", "MM", "Of a disk, ball or rod.", float)
@option("--mount", type=MOUNT, help="Where the scanner is.")
@taking("--poses", "FILES", "What holds the robot's poses.")
@taking("--pose-columns", "NAMES", '"x [m],y [m],z [m],w,p,r"; _ for others.')
@taking("--tool", "X Y Z A B C", "Poses' tool: mm; angles as theirs or W P R.", float)
@taking("--profiles", "FILES", "The profiles, a pattern.")
@taking("--columns", "X,Z", 'Names or numbers: x,z or "1 [mm],3 [mm]".')
@taking("--entry", "NAME", "Which list or pose of several.")
@taking("--where", "NAME=VALUE", "Rows to take: sensor=0.")
@taking("--x", "START PITCH", "x, if z is alone.", float)
@taking("--times", "START RATE", "When profiles in motion were taken: s, Hz.", float)
@taking("--unit", "UNIT", 'Of the profiles: mm, um, "0.01 um", inch, …')
@taking("--missing", "Z", "z of points where nothing was seen.", float)
@taking("--encoding", "NAME", "Of text that is not UTF-8.")
def import_(files, folder, **given):
    """Write the profiles and robot poses of DIR as a scan FOLDER.

    What is uncertain is asked; FOLDER/import.toml keeps the answers.
    """
    from profilecal.targets import TARGETS
    from profilecal_tool.importing.import_scan import import_scan
    from profilecal_tool.importing.questions import (
        SIZES,
        Layout,
        Question,
        options,
        read_answers,
        write_imported,
    )

    if not files.is_dir():
        raise ValueError(f"{files}: no such folder")
    given = {name: value for name, value in given.items() if value is not None}
    said = read_answers(folder) | given
    kind = said.get("target")
    if kind not in TARGETS:
        asked = f"--target is {kind or 'missing'}: what was scanned? one of"
        raise ValueError(f"{asked} {', '.join(TARGETS)}")
    for name in TARGETS[kind].lengths:
        if name not in said:
            raise ValueError(f"--{name} is missing: a {kind} has one, in mm")
    sizes = {name: said[name] for name in SIZES if name in said}
    layout = {n: v for n, v in said.items() if n not in {"target", *sizes}}
    with working("importing"):
        try:
            scan, taken = import_scan(files, kind, sizes, Layout(**layout))
        except Question as question:
            words = [str(files), str(folder), *options(said | question.answer)]
            line = f"profilecal import {shlex.join(words)}"
            raise ValueError(f"{question}\n{line}") from question
        write_imported(scan, folder, said, taken)
    echo("\n".join(f"{name:<15}{words}" for name, words in taken.items()))
    echo(f"{folder}/ written; next: profilecal check {folder}")


@main.command()
@argument("names", nargs=-1)
@option(
    "-p",
    "parameters",
    nargs=2,
    multiple=True,
    metavar="NAME VALUE",
    help="Set a notebook's parameter.",
)
@option(
    "--output",
    default="results",
    show_default=True,
    type=PLACE,
    help="Where it all goes.",
)
def reproduce(names, parameters, output):
    """Execute all notebooks, or those whose NAMES begin so.

    Counts the printed results that come out.
    """
    from profilecal_pages import items, notebooks

    given = {name: notebooks.parse_value(text) for name, text in parameters}
    with interruptible("The next run starts clean."):
        gathered, failed = notebooks.reproduce(notebooks.find(names), given, output)
    if gathered:
        table = items.tally(gathered).to_string(index=False)
        echo(f"{table}\n\n{items.sentence(gathered)}\n")
    echo(f"Notebooks, figures, tables and scorecard: {output}/")
    end_with(failed, output / "notebooks")


@main.command()
@argument("notebook")
@argument("grid", required=False, type=PLACE)
@option(
    "-p",
    "given",
    multiple=True,
    metavar="NAME=A,B,…",
    help="A parameter's values, beside those of GRID.",
)
@option(
    "--repeat",
    type=COUNT,
    help="So many runs of each point, with seeds of their own.",
)
@option("--output", required=True, type=PLACE, help="The folder for runs and table.")
@option(
    "--scheduler",
    envvar="DASK_SCHEDULER_ADDRESS",
    help="Of a Dask cluster; else all cores here.",
)
@option(
    "--timeout",
    type=COUNT,
    help="Seconds after which a cell counts as hung.",
)
@taking("--plot", "X Y", "Draw column Y of the table over column X.")
@option(
    "--hue", default="", metavar="COLUMN", help="A line for each value of this column."
)
def sweep(notebook, grid, given, output, plot, hue, **options):
    """Execute NOTEBOOK over a grid of parameters.

    NOTEBOOK is a file, or the name of one of ours. Started again, the sweep goes on
    where it was, and repeats no finished run.
    """
    from profilecal_pages import notebooks
    from profilecal_tool import sweep

    with interruptible("The same command goes on from here."):
        path = Path(notebook)
        if not notebook.endswith(".ipynb"):
            (path, *_) = notebooks.find([notebook])
        values = sweep.read_grid(grid, given)
        table, failed = sweep.sweep(path, values, output, **options)
        if plot:
            from profilecal_pages.figures import plot_columns

            echo(f"Figure: {plot_columns(table, *plot, hue, output)}")
    done = table["run"].nunique() - len(failed)
    echo(f"Runs: {done} done, {len(failed)} failed: {output / 'table.csv'}")
    executed = {path.stem for path in (output / "runs").glob("*.ipynb")}
    if others := len(executed - {*table["run"]}):
        echo(
            f"Not in it: {others} runs of other grids, kept in {output / 'runs'}; "
            "the same command as then gathers them again"
        )
    end_with(failed, output / "runs")


def end_with(failed, folder) -> None:
    """Name the runs that failed, with their notebooks in a folder; status 1 if any."""
    for name, why in failed.items():
        echo(f"FAILED {name}: {why} (see {folder / name}.ipynb)")
    raise SystemExit(1 if failed else 0)
