"""``dctorque init FILE``: a commented vehicle file, proposed from DBCs and logs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dctorque_can.cli.console import STDOUT, print_json, print_page, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import ForceOption, JsonOption

if TYPE_CHECKING:
    from dctorque_can.starter.starter import Starter


def init(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Vehicle file to be written (YAML).")],
    dbc: Annotated[list[Path], typer.Option("--dbc", metavar="DBC", help="DBC of the car; or several.")],
    log: Annotated[
        list[Path] | None,
        typer.Option(
            "--log", metavar="LOG", help="Recording of a drive; or several. Without, hardly anything is sure."
        ),
    ] = None,
    ask: Annotated[
        bool, typer.Option("--ask", help="Ask on the terminal about each proposal that is not sure.")
    ] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write a vehicle file for a new car: signals, protections, gears and timeouts proposed from DBCs and logs.

    Each proposal says how sure it is, and why; what is not found stays a marked gap.

    Exit codes: 0 the file is written, with gaps or without; 1 a DBC or log cannot be read, or the file exists;
    2 wrong usage; 3 written, but a part of a log could not be read.
    """
    from dctorque_can.logs.output_file import refuse_existing
    from dctorque_can.starter.document import vehicle_file
    from dctorque_can.starter.files import propose_from_files, write_new

    if ask and not sys.stdin.isatty():
        raise typer.BadParameter("asks on a terminal, and standard input is none", param_hint="--ask")
    logs = log or []
    inputs = [*dbc, *logs]
    refuse_existing(file, inputs, force)
    with progress_bar("reading") as progress:
        starter, problems = propose_from_files(dbc, logs, progress)
    if ask:
        starter = _asked(starter)
    write_new(file, vehicle_file(starter, file, logs), inputs, force=force)
    for problem in problems:
        warn(problem)
    _show(starter, file, logs, problems, as_json)
    if problems:
        raise typer.Exit(ExitCode.INCOMPLETE)


def _show(starter: Starter, file: Path, logs: list[Path], problems: list[str], as_json: bool) -> None:
    from dctorque_can.report.inputs_table import PAGE_WIDTH
    from dctorque_can.report.starter_table import gap_lines, starter_json, starter_table, summary

    for remark in starter.remarks:
        warn(remark)
    if as_json:
        print_json(starter_json(starter, str(file), problems))
        return
    width = STDOUT.width if STDOUT.is_terminal else max(STDOUT.width, PAGE_WIDTH)
    print_page(starter_table(starter, width), width)
    for line in gap_lines(starter):
        STDOUT.print(line, soft_wrap=True)
    STDOUT.print(summary(starter, str(file)), markup=False, soft_wrap=True)
    say(f"next: fill the gaps, then dctorque check {file}" + "".join(f" --log {each}" for each in logs))


def _asked(starter: Starter) -> Starter:
    """Return the proposals after the user has looked at each doubtful one."""
    for each in starter.proposals:
        if each.level == "sure":
            continue
        say(f"{each.key}: {each.level}: {'; '.join(each.why)}")
        names = [each.entry.name, *(other.entry.name for other in each.alternatives)]
        for number, name in enumerate(names, 1):
            say(f"  {number}  {name}")
        say("  0  none of these")
        choice = typer.prompt("which", default=1, type=int)
        while not 0 <= choice <= len(names):
            choice = typer.prompt(f"a number from 0 to {len(names)}", default=1, type=int)
        starter = starter.answered(each.key, choice)
    return starter
