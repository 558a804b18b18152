"""Entry point of ``dctorque``: subcommands, error messages, exit codes.

The file of a subcommand is imported when that one is called; ``--help`` asks all of them for their first line. It
imports what it needs when it runs.
"""

from __future__ import annotations

import atexit
import gc
import logging
import sys
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from dctorque_can import __version__
from dctorque_can.cli.compile_notice import compiling_is_told
from dctorque_can.cli.console import fail
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.late_asammdf import late_asammdf

DEBUG = "--debug"
COMMANDS = (
    "run",
    "status",
    "replay",
    "simulate",
    "demo",
    "compare",
    "study",
    "init",
    "check",
    "clutch-map",
    "identify",
    "design",
    "recover",
    "convert",
    "warm-up",
)
"""Each is the function of that name in the file of that name (``_`` for ``-``), in the order of ``--help``."""
_SETTINGS = {"help_option_names": ["-h", "--help"]}


class FromFiles(dict[str, Any]):
    """The subcommands by name, each made from its file when somebody takes it."""

    def __init__(self) -> None:
        super().__init__(dict.fromkeys(COMMANDS))

    def __getitem__(self, name: str) -> Any:
        if name not in self:
            raise KeyError(name)
        alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, context_settings=_SETTINGS)
        word = name.replace("-", "_")
        alone.command(name)(getattr(import_module(f"dctorque_can.cli.{word}"), word))
        return get_command(alone)

    def get(self, name: str, default: Any = None) -> Any:
        """Return the subcommand of that name, or ``default``."""
        try:
            return self[name]
        except KeyError:
            return default


class Commands(TyperGroup):
    """``dctorque`` itself, whose subcommands are not imported before they are needed."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = FromFiles()


app = typer.Typer(
    name="dctorque",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=_SETTINGS,
    help="Clutch torques of a dual clutch transmission, estimated from its CAN frames.",
    epilog="Exit codes: 0 done, 1 error (one line on stderr), 2 wrong usage, 3 done but something was missing "
    "(damaged input, dropped log frames), 78 `run`: the vehicle file is wrong, 130 interrupted.",
)


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
    atexit.register(gc.freeze)  # or the end of the process spends a second on collecting compiled code
    logging.getLogger("can").addHandler(logging.NullHandler())  # its errors come to us as exceptions too
    with late_asammdf(), compiling_is_told():
        sys.exit(_outcome(sys.argv[1:]))


def _outcome(arguments: list[str]) -> int:
    """Run one command and return the exit code of its failure; a success exits itself."""
    command = [word for word in arguments if word != DEBUG]
    if DEBUG in arguments:
        app(args=command, prog_name="dctorque")  # Python itself shows the traceback
    try:
        app(args=command, prog_name="dctorque")
    except DctorqueError as error:
        fail(str(error))
        return error.exit_code
    except OSError as error:
        fail(f"{error.filename}: {error.strerror}" if error.filename else str(error))
    except Exception as error:  # noqa: BLE001  the last line of defence: nobody asked for a traceback
        fail(f"unexpected {type(error).__name__}: {error} (please run with --debug and report it)")
    return ExitCode.ERROR
