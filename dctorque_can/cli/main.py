"""Entry point of ``dctorque``: subcommands, error messages, exit codes.

Every subcommand imports what it needs when it runs, so that ``--help`` stays quick.
"""

from __future__ import annotations

import logging
import sys
from typing import Annotated

import typer

from dctorque_can import __version__
from dctorque_can.cli.check import check
from dctorque_can.cli.compare import compare
from dctorque_can.cli.console import fail
from dctorque_can.cli.demo import demo
from dctorque_can.cli.design import design
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.recover import recover
from dctorque_can.cli.replay import replay
from dctorque_can.cli.run import run
from dctorque_can.cli.simulate import simulate
from dctorque_can.cli.study import study
from dctorque_can.errors import DctorqueError

DEBUG = "--debug"

app = typer.Typer(
    name="dctorque",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Clutch torques of a dual clutch transmission, estimated from its CAN frames.",
    epilog="Exit codes: 0 done, 1 error (one line on stderr), 2 wrong usage, 3 done but something was missing "
    "(damaged input, dropped log frames), 130 interrupted.",
)


for subcommand in (run, replay, simulate, demo, compare, study, check, design, recover):
    app.command()(subcommand)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"dctorque {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit."),
    ] = False,
    debug: Annotated[
        bool, typer.Option(DEBUG, help="Show a traceback on errors; may also stand after the command.")
    ] = False,
) -> None:
    """Read the options that stand before the command; ``main`` has taken out ``--debug`` already."""


def main() -> None:
    """Run the command line and exit."""
    logging.getLogger("can").addHandler(logging.NullHandler())  # its errors come to us as exceptions too
    arguments = sys.argv[1:]
    command = [word for word in arguments if word != DEBUG]
    if DEBUG in arguments:
        app(args=command, prog_name="dctorque")  # Python itself shows the traceback
    try:
        app(args=command, prog_name="dctorque")
    except DctorqueError as error:
        fail(str(error))
        sys.exit(error.exit_code)
    except OSError as error:
        fail(f"{error.filename}: {error.strerror}" if error.filename else str(error))
    except Exception as error:  # noqa: BLE001  the last line of defence: nobody asked for a traceback
        fail(f"unexpected {type(error).__name__}: {error} (please run with --debug and report it)")
    sys.exit(ExitCode.ERROR)
