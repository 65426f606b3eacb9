"""The command line: thin. Wrong input ends with status 2 and one sentence, a failed notebook with status 1."""

import signal
from pathlib import Path

import click


class Refused(click.ClickException):
    """Wrong input, said in one sentence."""

    exit_code = 2

    def show(self, file=None):
        click.echo(f"profilecal: {self.message}", err=True)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="profilecal")
def main():
    """Hand-eye calibration of 2D laser profile scanners on robots."""


@main.command()
@click.argument("names", nargs=-1)
@click.option("-p", "parameters", nargs=2, multiple=True, metavar="NAME VALUE", help="Set a notebook's parameter.")
@click.option(
    "--output", default="results", show_default=True, type=click.Path(path_type=Path), help="Where it all goes."
)
def reproduce(names, parameters, output):
    """Execute the notebooks whose NAMES (or beginnings of names) are given, or all, and print the scorecard."""
    from profilecal import notebooks
    from profilecal.reproduce import reproduce as run

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # `timeout` and `kill` clean up as Ctrl-C does
    try:
        chosen = notebooks.find(names)
        scorecard, failed = run(chosen, {name: notebooks.parse_value(text) for name, text in parameters}, output)
    except (ValueError, OSError) as error:
        raise Refused(str(error)) from error
    except KeyboardInterrupt:
        click.echo("\nInterrupted. The next run starts clean.", err=True)
        raise SystemExit(130) from None

    print_scorecard(scorecard)
    click.echo(f"Notebooks, figures, tables and scorecard: {output}/")
    for name, why in failed.items():
        click.echo(f"FAILED {name}: {why} (see {output / 'notebooks' / name}.ipynb)")
    raise SystemExit(1 if failed else 0)


@main.command()
@click.argument("notebook")
@click.argument("grid", required=False, type=click.Path(path_type=Path))
@click.option("-p", "given", multiple=True, metavar="NAME=A,B,…", help="A parameter's values, beside those of GRID.")
@click.option("--zip", "zipped", is_flag=True, help="First values together, second values together, …; else all pairs.")
@click.option("--repeat", type=click.IntRange(1), help="Run each point so often, with seeds of their own.")
@click.option("--output", required=True, type=click.Path(path_type=Path), help="The folder for runs and table.")
@click.option("--scheduler", envvar="DASK_SCHEDULER_ADDRESS", help="Address of a Dask scheduler; else all cores here.")
@click.option("--timeout", type=click.FloatRange(0, min_open=True), help="Seconds after which a run counts as hung.")
@click.option("--parquet", is_flag=True, help="Write table.parquet instead of table.csv.")
@click.option("--plot", nargs=2, metavar="X Y", help="Draw column Y of the table over column X.")
@click.option("--hue", default="", metavar="COLUMN", help="A line for each value of this column.")
def sweep(notebook, grid, given, output, plot, hue, **options):
    """Execute NOTEBOOK, a file or the name of one of ours, over the parameters in the file GRID and of -p.

    Started again it goes on where it was, and repeats no finished run.
    """
    from profilecal import notebooks
    from profilecal.sweep import read_grid
    from profilecal.sweep import sweep as run

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        path = Path(notebook) if notebook.endswith(".ipynb") else notebooks.find([notebook])[0]
        done = run(path, read_grid(grid, given), output, **options)
        if plot:
            from profilecal.report import plot_columns

            click.echo(f"Figure: {plot_columns(done.table, *plot, hue, output)}")
    except (ValueError, OSError) as error:
        raise Refused(str(error)) from error
    except KeyboardInterrupt:
        click.echo("\nInterrupted. The same command goes on from here.", err=True)
        raise SystemExit(130) from None

    click.echo(f"{done.table['run'].nunique() - len(done.failed)} runs done, {len(done.failed)} failed: {done.path}")
    for name, why in done.failed.items():
        click.echo(f"FAILED {name}: {why} (see {output / 'runs' / name}.ipynb)")
    raise SystemExit(1 if done.failed else 0)


def print_scorecard(frame):
    """The scorecard as a table on the terminal."""
    from rich.console import Console
    from rich.table import Table

    from profilecal.scorecard import to_text

    colours = {"reproduced": "green", "compatible": "yellow", "differs": "red"}
    columns = ["paper", "item", "quantity", "published", "ours", "unit", "tolerance", "verdict"]
    table = Table(padding=0)
    for column in columns:
        number = column in ("published", "ours", "tolerance")
        table.add_column(column, justify="right" if number else "left", overflow="fold")
    for values in to_text(frame)[columns].to_dict("records"):
        values["verdict"] = f"[{colours.get(values['verdict'], 'default')}]{values['verdict']}[/]"
        table.add_row(*values.values())
    console = Console()
    Console(width=console.width if console.is_terminal else 140).print(table)
