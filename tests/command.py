"""The command line, as a user calls it."""

from click.testing import CliRunner

from profilecal.cli import main


def run(*arguments):
    """The result of `profilecal` with these arguments."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments])
