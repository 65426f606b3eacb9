"""The command line: thin. Wrong input ends with status 2 and one sentence, a failed
notebook with status 1.
"""

import os
import signal
from contextlib import contextmanager
from pathlib import Path

import click

# what cannot be read, read_scan says in one sentence
SCAN = click.Path(path_type=Path, readable=False)
PLACE = click.Path(path_type=Path)
MOUNT = click.Choice(["eye-in-hand", "eye-to-hand"])


class Commands(click.Group):
    """Commands that say in one sentence what is wrong with their input."""

    def invoke(self, ctx):
        """Carry out a command; wrong input ends it with status 2."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            raise  # nobody reads on: click ends quietly
        except (OSError, ValueError) as error:
            name = getattr(error, "filename", None)
            click.echo(
                f"profilecal: {f'{name}: {error.strerror}' if name else error}",
                err=True,
            )
            raise SystemExit(2) from error


@contextmanager
def interruptible(sentence: str):
    """Ctrl-C, `kill` and `timeout` end here with status 130, after everything is
    cleaned up.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    except KeyboardInterrupt:
        click.echo(f"\nInterrupted. {sentence}", err=True)
        raise SystemExit(130) from None


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="profilecal")
def main():
    """Hand-eye calibration of 2D laser profile scanners on robots."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(
            name, "1"
        )  # before NumPy loads: more threads gain nothing here, and wait for each other


@main.command()
@click.argument("names", nargs=-1)
@click.option(
    "-p",
    "parameters",
    nargs=2,
    multiple=True,
    metavar="NAME VALUE",
    help="Set a notebook's parameter.",
)
@click.option(
    "--output",
    default="results",
    show_default=True,
    type=PLACE,
    help="Where it all goes.",
)
def reproduce(names, parameters, output):
    """Execute all notebooks, or those whose NAMES begin so. Counts the printed results
    that come out.
    """
    from profilecal_pages import items, notebooks

    given = {name: notebooks.parse_value(text) for name, text in parameters}
    with interruptible("The next run starts clean."):
        gathered, failed = notebooks.reproduce(notebooks.find(names), given, output)
    if gathered:
        click.echo(
            f"{items.tally(gathered).to_string(index=False)}\n\n{items.sentence(gathered)}\n"
        )
    click.echo(f"Notebooks, figures, tables and scorecard: {output}/")
    end_with(failed, output / "notebooks")


@main.command()
@click.argument("folders", nargs=-1, required=True, type=SCAN)
@click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object instead of a table."
)
@click.option(
    "--to",
    "vendor",
    metavar="NAME",
    help="abb, kuka, ur, fanuc, staubli, ros or matrix: a pose to paste.",
)
@click.option(
    "--guess",
    nargs=6,
    type=float,
    metavar="X Y Z W P R",
    help="Mount to start from, mm and degrees.",
)
@click.option(
    "--leave-out",
    is_flag=True,
    help="Cross-validate: predict each flange orientation from the others.",
)
@click.option(
    "--report", type=PLACE, help="Write a report with pictures to this HTML file."
)
def calibrate(folders, as_json, vendor, guess, leave_out, report):
    """Find the sensor pose from scan folders of one sensor."""
    import json
    from dataclasses import replace

    import numpy as np

    from profilecal.calibration import calibration
    from profilecal.geometry.poses import homogeneous, rotation_from_xyz_angles
    from profilecal.scan.folder import read_scan
    from profilecal_tool.controllers import check_controller, for_controller
    from profilecal_tool.words import calibration_text

    if vendor and as_json:
        raise ValueError(
            "--json prints one JSON object and nothing else; ask for --to without it"
        )
    if vendor:
        check_controller(vendor)  # before any work
    if report:
        from profilecal_tool.report.page import check_report

        check_report(report)
    if guess and not np.isfinite(guess).all():
        raise ValueError(
            f"--guess is {' '.join(map(str, guess))}; expected six numbers, mm and degrees"
        )
    mount = (
        homogeneous(rotation_from_xyz_angles(np.radians(guess[3:])), guess[:3])
        if guess
        else None
    )
    found = calibration.calibrate([read_scan(folder) for folder in folders], mount)
    known = found.status != "unobservable"
    if leave_out and known:
        from profilecal.calibration.verify import leave_out as cross_validate

        found = replace(
            found, messages=(*found.messages, *cross_validate(found).messages())
        )
    if found.status == "weak":
        from profilecal_tool.plan.command import next_poses

        advice = next_poses(found, folders[0], np.random.default_rng(0))
        found = replace(found, messages=(*found.messages, *filter(None, [advice])))
    to_paste = (
        for_controller(vendor, found.solution.pose, found.frame)
        if vendor and known
        else ""
    )
    click.echo(
        json.dumps(found.to_json(), indent=2)
        if as_json
        else calibration_text(found, to_paste)
    )
    if to_paste and found.status == "weak":
        click.echo(
            "profilecal: status weak, see the notes: this pose is not to be relied on",
            err=True,
        )
    if report:
        write_the_report(folders, report, guess=list(guess or []))
    raise SystemExit(0 if known else 3)


@main.command()
@click.argument("spec", type=PLACE)
@click.argument("folder", type=PLACE)
def simulate(spec, folder):
    """Write the scan that SPEC.toml describes into a new FOLDER. Its truth is in
    truth.toml.
    """
    from profilecal.scan.folder import write_scan
    from profilecal.scan.toml import read_toml
    from profilecal.simulation.spec import read_spec, simulate_scan

    write_scan(simulate_scan(read_spec(read_toml(spec), spec)), folder)
    click.echo(f"{folder}/ written; its truth is in truth.toml")


@main.command()
@click.argument("spec", type=PLACE)
@click.argument("folder", required=False, type=PLACE)
@click.option(
    "--poses",
    type=click.IntRange(1, 1000),
    help="So many; else as many as --until takes.",
)
@click.option(
    "--until",
    nargs=2,
    type=float,
    metavar="MM DEG",
    help="Largest standard deviations in any direction.",
)
@click.option(
    "--of",
    "given",
    type=SCAN,
    metavar="POSES",
    help="Predict these instead: a CSV file, a scan folder.",
)
def plan(spec, folder, poses, until, given):
    """Choose the poses that calibrate SPEC.toml best.

    They go into a new FOLDER, ready to run. SPEC may be a scan folder: its answer says
    where everything is.
    """
    from contextlib import nullcontext

    from profilecal.scan.tables import new_folder
    from profilecal_tool.plan import command

    if given and (folder or poses or until):
        raise ValueError(
            "--of predicts the given poses and writes nothing; leave FOLDER, --poses and --until out"
        )
    with interruptible("Nothing was written."):
        task = command.task(spec, poses, until)
        if given:
            found, unseen = task.prediction_of(given)
            click.echo(
                "\n".join(
                    [
                        *command.believed(task.model),
                        *command.predicted(found, task.model, unseen),
                    ]
                )
            )
            return
        with new_folder(folder) if folder else nullcontext() as partial:
            found = task.plan()
            if folder:
                from profilecal_tool.report.pictures import save_plan

                command.write_plan(task, found, partial)
                save_plan(found, partial / "plan.png")
    click.echo(command.to_text(found, task.asked))
    if folder:
        click.echo(
            f"{folder}/ written; look at {folder / 'plan.png'}, drive {folder / 'poses.csv'}"
        )


@main.command()
@click.argument("folder", type=SCAN)
def check(folder):
    """Say what a scan FOLDER holds, before any calibration. Poses, groups, noise,
    outliers, motions.
    """
    from profilecal.calibration.observe import check as check_scan
    from profilecal.scan.folder import read_scan

    click.echo("\n".join(check_scan(read_scan(folder))))


@main.command()
@click.argument("folder", type=SCAN)
@click.option(
    "--with", "pose", required=True, type=SCAN, help="What calibrate --json printed."
)
def verify(folder, pose):
    """Compare a sensor pose with a scan FOLDER not used to find it. Status 1 if they
    contradict.
    """
    from profilecal.calibration import verify
    from profilecal.scan.folder import read_scan
    from profilecal_tool.words import verification_text

    scan = read_scan(folder)
    T, covariance, noise_mm, to_hand = verify.read_pose(pose)
    if to_hand != (scan.mount == "eye-to-hand"):
        raise ValueError(
            f"{pose} and {folder} disagree about the mount, which is {scan.mount} in the scan"
        )
    found = verify.verify(scan, T, covariance, noise_mm)
    click.echo(verification_text(found))
    raise SystemExit(0 if found.as_expected else 1)


@main.command("import")
@click.argument("files", metavar="DIR", type=PLACE)
@click.argument("folder", type=PLACE)
@click.option(
    "--target",
    "kind",
    required=True,
    metavar="KIND",
    help="What was scanned: edge, disk, ball, plane, …",
)
@click.option("--radius", type=float, help="Of a disk, ball or rod, mm.")
@click.option(
    "--mount", type=MOUNT, default="eye-in-hand", help="Where the scanner is."
)
@click.option(
    "--poses", default="", metavar="FILES", help="What holds the robot's poses."
)
@click.option(
    "--pose-columns",
    default="",
    metavar="NAMES",
    help='"x [m],y [m],z [m],w,p,r"; _ for others.',
)
@click.option(
    "--tool",
    nargs=6,
    type=float,
    metavar="X Y Z A B C",
    help="Poses' tool: mm; angles as theirs or W P R.",
)
@click.option(
    "--profiles", default="", metavar="FILES", help="The profiles, a pattern."
)
@click.option(
    "--columns",
    default="",
    metavar="X,Z",
    help='Names or numbers: x,z or "1 [mm],3 [mm]".',
)
@click.option(
    "--entry", default="", metavar="NAME", help="Which list of a YAML or NPZ file."
)
@click.option("--missing", type=float, help="z of points where nothing was seen.")
def import_(files, folder, kind, radius, **said):
    """Write the profiles and robot poses of DIR as a scan FOLDER.

    What is not said is guessed, and every guess is printed.
    """
    from profilecal.scan.folder import write_scan
    from profilecal_tool.importing.import_scan import Layout, import_scan

    scan, guessed = import_scan(
        files, kind, {} if radius is None else {"radius": radius}, Layout(**said)
    )
    write_scan(scan, folder)
    click.echo("\n".join(guessed))
    click.echo(f"{folder}/ written; next: profilecal check {folder}")


@main.command()
@click.argument("notebook")
@click.argument("grid", required=False, type=PLACE)
@click.option(
    "-p",
    "given",
    multiple=True,
    metavar="NAME=A,B,…",
    help="A parameter's values, beside those of GRID.",
)
@click.option(
    "--repeat",
    type=click.IntRange(1),
    help="So many runs of each point, with seeds of their own.",
)
@click.option(
    "--output", required=True, type=PLACE, help="The folder for runs and table."
)
@click.option(
    "--scheduler",
    envvar="DASK_SCHEDULER_ADDRESS",
    help="Of a Dask cluster; else all cores here.",
)
@click.option(
    "--timeout",
    type=click.IntRange(1),
    help="Seconds after which a cell counts as hung.",
)
@click.option(
    "--plot", nargs=2, metavar="X Y", help="Draw column Y of the table over column X."
)
@click.option(
    "--hue", default="", metavar="COLUMN", help="A line for each value of this column."
)
def sweep(notebook, grid, given, output, plot, hue, **options):
    """Execute NOTEBOOK over a grid of parameters.

    A file, or the name of one of ours. Started again it goes on where it was, and
    repeats no finished run.
    """
    from profilecal_pages import notebooks
    from profilecal_tool import sweep

    with interruptible("The same command goes on from here."):
        path = (
            Path(notebook)
            if notebook.endswith(".ipynb")
            else notebooks.find([notebook])[0]
        )
        table, failed = sweep.sweep(
            path, sweep.read_grid(grid, given), output, **options
        )
        if plot:
            from profilecal_pages.figures import plot_columns

            click.echo(f"Figure: {plot_columns(table, *plot, hue, output)}")
    click.echo(
        f"Runs: {table['run'].nunique() - len(failed)} done, {len(failed)} failed: {output / 'table.csv'}"
    )
    end_with(failed, output / "runs")


def end_with(failed, folder):
    """Name the runs that failed, whose notebooks are in a folder; status 1 if there are
    any.
    """
    for name, why in failed.items():
        click.echo(f"FAILED {name}: {why} (see {folder / name}.ipynb)")
    raise SystemExit(1 if failed else 0)


def write_the_report(folders, path, **parameters):
    """The report on some scan folders; status 1 where it fails."""
    from profilecal_pages.notebooks import NotebookError
    from profilecal_tool.report.page import write_report

    try:
        with interruptible(f"{path} is as it was."):
            write_report(folders, path, **parameters)
    except (NotebookError, OSError) as error:
        click.echo(f"profilecal: no report: {error}", err=True)
        raise SystemExit(1) from error
    click.echo(f"Report: {path}", err=True)
