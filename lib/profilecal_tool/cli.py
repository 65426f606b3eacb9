"""The command line, which is thin.

Wrong input ends with status 2 and one sentence, a failed notebook with status 1. What
is heavy is imported where a command needs it.
"""

import os
import shlex
import signal
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import click
from click import Choice, IntRange, argument, echo, option
from tqdm import tqdm

import profilecal as pc
from profilecal.geometry.progress import watcher
from profilecal_tool.controllers import CONTROLLERS, for_controller

# what cannot be read, the library says in one sentence
PATH = click.Path(path_type=Path, readable=False)
COUNT = IntRange(1)
ON_TERMINAL = {"disable": None, "leave": False}
STOPPED = "profilecal.stopped"  # where a command says what it leaves if interrupted


class Commands(click.Group):
    """Commands that say in one sentence what is wrong with their input, and what they
    leave if interrupted.
    """

    def invoke(self, context):
        """Carry out a command; wrong input ends it with status 2, Ctrl-C, `kill` and
        `timeout` with 130.
        """
        try:
            return super().invoke(context)
        except KeyboardInterrupt:
            left = context.meta.get(STOPPED, "Nothing was written.")
            echo(f"\nInterrupted. {left}", err=True)
            raise SystemExit(130) from None
        except BrokenPipeError:
            raise  # nobody reads on: click ends quietly
        except MemoryError:
            end("more than the memory holds: thin it out")
        except OSError as error:
            named = error.filename and f"{error.filename}: {error.strerror}"
            end(named or error)
        except ValueError as error:
            end(error)


def if_stopped(sentence):
    """From now on an interrupted command says this."""
    click.get_current_context().meta[STOPPED] = sentence


def end(sentence, status=2):
    """Say why it ends, with a status."""
    echo(f"profilecal: {sentence}", err=True)
    raise SystemExit(status)


def show(lines):
    """Print lines, each a name and a text."""
    from profilecal_tool.words import printed

    echo(printed(lines))


def working(doing):
    """Say on a terminal what is being done, until that ends."""
    return tqdm(bar_format=f"{doing} …", **ON_TERMINAL)


def taking(name, metavar, words, kind=str, **more):
    """An option that takes a value for each word of `metavar`."""
    count = len(metavar.split())
    return option(name, nargs=count, type=kind, metavar=metavar, help=words, **more)


def writing(name, words, *endings):
    """An option that takes a place where a file of such an ending can be written."""

    def checked(context, parameter, path):
        if path and path.suffix.lower() not in endings:
            raise ValueError(
                f"{name} is {path}; expected a name that ends in {' or '.join(endings)}"
            )
        if path and (path.is_dir() or not os.access(path.parent, os.W_OK)):
            raise ValueError(f"{path}: no file can be written there")
        return path

    return option(name, type=PATH, callback=checked, help=words)


FOLDER = argument("folder", type=PATH)
ANSWER = option(
    "--with", "answer", required=True, type=PATH, help="What calibrate --json printed."
)
CLOUD = writing("--cloud", "Write all profiles put together to this PLY file.", ".ply")


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="profilecal")
def main():
    """Hand-eye calibration of 2D laser profile scanners on robots."""
    # Before NumPy loads: more threads gain nothing here, and wait for each other.
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    watcher.set(partial(tqdm, delay=2, **ON_TERMINAL))


@main.command()
@argument("folders", nargs=-1, required=True, type=PATH)
@option("--json", is_flag=True, help="Print one JSON object instead of a table.")
@taking(
    "--to", "NAME", f"{', '.join(CONTROLLERS)}: a pose to paste.", Choice(CONTROLLERS)
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
@taking(
    "--self-test",
    "N",
    "Simulate so many scans from the answer: do its uncertainties hold?",
    IntRange(10),
)
@writing("--report", "Write a report with pictures to this HTML file.", ".html", ".htm")
@CLOUD
def calibrate(folders, json, to, guess, guess_sd, self_test, report, cloud):
    """Find the sensor pose from scan folders of one sensor."""
    if to and json:
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
    if_stopped("Above is what was found until then.")
    notes = [*found.messages]
    try:
        notes += further_notes(found, folders[0], self_test, guess)
    finally:
        found = replace(found, messages=tuple(notes))
        guesses = {"guess": [*(guess or [])], "guess_sd": [*(guess_sd or [])]}
        print_answer(found, folders, guesses, json, to)
    if report:
        print_report(folders, report, guesses)
    if found.is_known:
        put_together(found, found.pose, cloud)
    raise SystemExit(0 if found.is_known else 3)


def further_notes(found, folder, count, guess):
    """What so many simulated scans do and, where the poses leave an answer weak, which
    further ones would help; not beside a guess, of which `plan` would not know.
    """
    if not found.is_known:
        return
    if count:
        with working("testing"):
            yield pc.self_test(found, count).sentence
    if found.solution.observability.status == "weak" and not guess:
        from profilecal_tool.plan.task import next_poses

        with working("planning further poses"):
            yield from next_poses(found, folder)


def print_answer(found, folders, guesses, json, to):
    """Print what was found as JSON; or in words, with its pose for a controller and
    what to do next.
    """
    from profilecal.calibration.calibration import answer_text
    from profilecal_tool.words import calibration_lines

    if json:
        echo(answer_text(found))
        return
    to_paste = ""
    if to and found.is_known:
        to_paste = for_controller(to, found.pose, found.frame)
    show(calibration_lines(found, to_paste))
    if found.status == "ok":
        words = [*folders]
        for name, numbers in guesses.items():
            if numbers:
                words += [f"--{name.replace('_', '-')}", *numbers]
        keep = f"profilecal calibrate {shlex.join(map(str, words))} --json > T.json"
        echo(f"next: {keep}\nthen: profilecal verify or check-mount SCAN --with T.json")
        return
    if to:
        pose = "this pose is not to be relied on" if to_paste else "no pose to paste"
        echo(f"profilecal: {pose}: see the notes", err=True)
    echo("next: do what the notes say, and calibrate again")


def print_report(folders, path, guesses):
    """Write the report on some scan folders; status 1 where it fails."""
    from profilecal_pages.notebooks import NotebookError
    from profilecal_tool.report.page import write_report

    if_stopped(f"{path} was not written.")
    try:
        write_report(folders, path, **guesses)
    except (NotebookError, OSError) as error:
        end(f"no report: {error}", 1)
    echo(f"Report: {path}", err=True)


def put_together(found, pose, path):
    """Write what was seen from all poses, as a sensor pose has it."""
    if path:
        from profilecal_tool.report.cloud import write_cloud

        write_cloud(found, pose, path)
        echo(f"Cloud: {path}", err=True)


def end_as(check):
    """End with the status of a check: 0 as expected, 1 if not, 2 if it cannot tell."""
    if not check.as_expected:
        raise SystemExit(1)
    raise SystemExit(0 if check.is_conclusive else 2)


@main.command()
@FOLDER
def check(folder):
    """Say what a scan FOLDER holds, before any calibration.

    Poses, groups, noise, motions.
    """
    from profilecal_tool.checking import check

    with working("checking"):
        lines = [*check(pc.read_scan(folder))]
    show(lines)
    first = "mind the notes, then " if "note" in dict(lines) else ""
    echo(f"next: {first}profilecal calibrate {shlex.quote(str(folder))}")


@main.command()
@argument("other", metavar="FOLDER|T2.json", type=PATH)
@ANSWER
@CLOUD
def verify(other, answer, cloud):
    """Compare an answer with another scan or another answer.

    The scan in FOLDER must not be one that T.json was found from. Status 1 if they
    contradict each other, 2 if FOLDER cannot tell.
    """
    from profilecal_tool.words import verification_lines

    with working("verifying"):
        is_answer = other.suffix == ".json"
        if is_answer and cloud:
            raise ValueError(f"--cloud is of a scan; expected a folder, not {other}")
        read = pc.read_answer if is_answer else pc.read_scan
        other, answer = read(other), pc.read_answer(answer)
        checked = pc.verify(answer, other)
    show(verification_lines(checked, answer))
    put_together(checked.other, answer.pose, cloud)
    end_as(checked)


@main.command()
@FOLDER
@ANSWER
@writing("--log", "A CSV file to add a row to, and its picture beside.", ".csv")
def check_mount(folder, answer, log):
    """Has anything moved since T.json? A few poses tell.

    FOLDER is a scan of the calibration's target where it stood then; one to three poses
    are enough. Status 1 if anything has moved, 2 if FOLDER cannot tell.
    """
    from profilecal_tool.words import mount_check_lines

    answer, scan = pc.read_answer(answer), pc.read_scan(folder)
    checked = pc.check_mount(answer, scan)
    show(mount_check_lines(checked, scan.kind))
    if log:
        from profilecal_tool.report.log import add_to_log

        show([("log", f"{log}, drawn in {add_to_log(checked, folder, log)}")])
    end_as(checked)


@main.command()
@argument("spec", type=PATH)
@FOLDER
@taking(
    "--scan", "N", "Another scan of the same scanner, target and robot: 2, 3, …", COUNT
)
def simulate(spec, folder, scan):
    """Write the scan that SPEC.toml describes into a new FOLDER.

    Its truth is in truth.toml.
    """
    from profilecal.scan.toml import read_toml
    from profilecal.simulation.spec import simulate_scan
    from profilecal_tool.plan.specification import read_specification

    entries, place = read_toml(spec), shlex.quote(str(folder))
    if "guess" in entries and "poses" not in entries:
        raise ValueError(f"{spec} has [guess] but no poses: profilecal plan adds them")
    after = f"profilecal check {place} && profilecal calibrate {place}"
    if scan:
        entries["scan"] = scan
        after = f"profilecal check-mount {place} --with T.json"
    pc.write_scan(simulate_scan(read_specification(entries, spec)), folder)
    echo(f"{folder}/ written; its truth is in truth.toml\nnext: {after}")


@main.command()
@argument("spec", type=PATH)
@argument("folder", required=False, type=PATH)
@taking("--poses", "N", "So many; else as many as --until takes.", IntRange(1, 1000))
@taking("--until", "MM DEG", "Largest standard deviations in any direction.", float)
@taking(
    "--within",
    "SPEC.toml",
    "After a scan: its [plan] says where the robot may go.",
    PATH,
)
@taking("--of", "POSES", "Predict these instead: a CSV file, a scan folder.", PATH)
def plan(spec, folder, poses, until, within, of):
    """Choose the best poses for what SPEC.toml describes.

    They go into a new FOLDER, ready to run. SPEC may be a scan folder: its answer says
    where everything is.
    """
    from profilecal.scan.tables import new_folder
    from profilecal_tool.plan import words
    from profilecal_tool.plan.task import read_task

    if of and (folder or poses or until):
        raise ValueError(
            "--of predicts the given poses and writes nothing; "
            "leave FOLDER, --poses and --until out"
        )
    written = new_folder(folder) if folder else nullcontext()
    with working("planning"), written as partial:
        task = read_task(spec, poses, until, within)
        designed = task.plan_of(of) if of else task.plan()
        if partial:
            from profilecal_tool.report.pictures import save_plan

            task.write(designed, partial)
            save_plan(designed, partial / "plan.png")
    lines = words.plan_lines(designed)
    if not of:
        lines += words.steps(designed, spec, folder)
    echo("\n".join(lines))


@main.command("import")
@argument("files", metavar="DIR", type=PATH)
@FOLDER
@taking("--target", "KIND", "An edge, disk, ball, plane, rod or point.")
@taking("--radius", "MM", "Of a disk, ball or rod.", float)
@option(
    "--mount",
    type=Choice(["eye-in-hand", "eye-to-hand"]),
    help="Where the scanner is.",
)
@taking("--poses", "FILES", "What holds the robot's poses.")
@taking("--pose-columns", "NAMES", '"x [mm],y [mm],z [mm],w,p,r"; _ for others.')
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
    from profilecal_tool.importing import questions
    from profilecal_tool.importing.import_scan import import_scan

    if not files.is_dir():
        raise ValueError(f"{files}: no such folder")
    given = {name: value for name, value in given.items() if value is not None}
    said = questions.read_answers(folder) | given
    rest = dict(said)
    kind = rest.pop("target", "missing")
    if kind not in TARGETS:
        kinds = ", ".join(TARGETS)
        raise ValueError(f"--target is {kind}: what was scanned? one of {kinds}")
    for name in TARGETS[kind].size_names:
        if name not in said:
            raise ValueError(f"--{name} is missing: a {kind} has one, in mm")
    sizes = {name: rest.pop(name) for name in questions.SIZES & said.keys()}
    try:
        with working("importing"):
            layout = questions.Layout(**rest)
            scan, taken = import_scan(files, kind, sizes, layout)
    except questions.Question as question:
        words = questions.options(said | question.answer)
        line = shlex.join([str(files), str(folder), *words])
        raise ValueError(f"{question}\nprofilecal import {line}") from None
    questions.write_imported(scan, folder, said, taken)
    show(taken.items())
    place = shlex.quote(str(folder))
    echo(f"{folder}/ written; next: profilecal check {place}")


@main.command()
@argument("names", nargs=-1)
@taking("-p", "NAME VALUE", "Set a notebook's parameter.", multiple=True)
@taking(
    "--output", "DIR", "Where it all goes.", PATH, default="results", show_default=True
)
def reproduce(names, p, output):
    """Execute all notebooks, or those whose NAMES begin so.

    Counts the printed results that come out.
    """
    from profilecal_pages import items, notebooks

    if_stopped("The next run starts clean.")
    given = {name: notebooks.parse_value(text) for name, text in p}
    gathered, failed = notebooks.reproduce(notebooks.find(names), given, output)
    if gathered:
        table = items.tally(gathered).to_string(index=False)
        echo(f"{table}\n\n{items.sentence(gathered)}\n")
    echo(f"Notebooks, figures, tables and scorecard: {output}/")
    end_with(failed, output / "notebooks")


@main.command()
@argument("notebook")
@argument("grid", required=False, type=PATH)
@taking(
    "-p", "NAME=A,B,…", "A parameter's values, beside those of GRID.", multiple=True
)
@taking("--repeat", "N", "So many runs of each point, with seeds of their own.", COUNT)
@taking("--output", "DIR", "The folder for runs and table.", PATH, required=True)
@taking(
    "--scheduler",
    "ADDRESS",
    "Of a Dask cluster; else all cores here.",
    envvar="DASK_SCHEDULER_ADDRESS",
)
@taking("--timeout", "S", "Seconds after which a cell counts as hung.", COUNT)
@taking("--plot", "X Y", "Draw column Y of the table over column X.")
@taking("--hue", "COLUMN", "A line for each value of this column.", default="")
def sweep(notebook, grid, p, output, plot, hue, **options):
    """Execute NOTEBOOK over a grid of parameters.

    NOTEBOOK is a file, or the name of one of ours. Started again, the sweep goes on
    where it was, and repeats no finished run.
    """
    from profilecal_pages import notebooks
    from profilecal_pages.figures import plot_columns
    from profilecal_tool import sweep

    if_stopped("The same command goes on from here.")
    path = Path(notebook)
    if not notebook.endswith(".ipynb"):
        path, *more = notebooks.find([notebook])
        if more:
            raise ValueError(f"{notebook} may be {path.stem} or {more[0].stem}")
    values = sweep.read_grid(grid, p)
    table, failed = sweep.sweep(path, values, output, **options)
    if plot:
        echo(f"Figure: {plot_columns(table, *plot, hue, output)}")
    runs, count = output / "runs", table["run"].nunique()
    echo(
        f"Runs: {count - len(failed)} done, {len(failed)} failed: "
        f"{output / 'table.csv'}"
    )
    if others := len([*runs.glob("*.ipynb")]) - count:
        echo(
            f"Not in it: {others} of other grids, kept in {runs}; "
            "the same command as then gathers them again"
        )
    end_with(failed, runs)


def end_with(failed, folder):
    """Name the runs that failed, with their notebooks in a folder; status 1 if any."""
    for name, why in failed.items():
        echo(f"FAILED {name}: {why} (see {folder / name}.ipynb)")
    raise SystemExit(1 if failed else 0)
