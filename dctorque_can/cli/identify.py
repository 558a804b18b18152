"""``dctorque identify CONFIG --log DRIVE``: the most likely numbers of a vehicle file, by recorded drives."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dctorque_can.cli.console import STDOUT, print_json, print_page, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import JsonOption, SetOption

if TYPE_CHECKING:
    from dctorque_can.identify.command import Identified


class What(StrEnum):
    """Groups of numbers."""

    DELAYS = "delays"
    RATIOS = "ratios"
    INERTIAS = "inertias"
    STIFFNESSES = "stiffnesses"
    DAMPINGS = "dampings"
    CAR = "car"
    LOSSES = "losses"
    SPIN = "spin"
    ROAD = "road"
    KISSING_POINTS = "kissing_points"
    NOISES = "noises"


def identify(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="Vehicle file to begin with.")],
    log: Annotated[
        list[Path] | None,
        typer.Option("--log", metavar="LOG", help="Recording of a drive; best several, of ten minutes each."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Gets the vehicle file with what was found."),
    ] = None,
    what: Annotated[
        list[What] | None,
        typer.Option("--what", help="Group of numbers to look for; may be repeated. Default: all."),
    ] = None,
    plan: Annotated[
        bool,
        typer.Option(
            "--plan", help="Say which drives to record: all without --log, else those for what is lacking."
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the output file.")] = False,
    set_: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find the most likely numbers of a vehicle file in recorded drives, each with its uncertainty.

    What the drives do not tell stays as it was, and is named. Exit codes: 0 done; 1 the file or a log cannot be
    used; 2 wrong usage; 3 a part of a log cannot be read.
    """
    from dctorque_can.config.load import load_config
    from dctorque_can.config.overrides import parse_overrides
    from dctorque_can.identify.command import identify_logs
    from dctorque_can.report.identified_table import plan_lines, summary_lines, tables
    from dctorque_can.resources import find_config

    try:
        overrides = parse_overrides(set_ or [])
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--set") from error
    if not log:
        if not plan:
            raise typer.BadParameter("name recordings (--log), or ask for a plan (--plan)", param_hint="--log")
        for line in plan_lines(None):
            say(line)
        return
    if output is not None and overrides:
        raise typer.BadParameter("writes the file, not what --set lays over it: leave one out", param_hint="-o")
    loaded = load_config(find_config(config), overrides)
    groups = tuple(each.value for each in what or What)
    with progress_bar("identifying") as progress:
        found = identify_logs(loaded, log, groups, output, force, progress)
    for problem in found.problems:
        warn(problem)
    if as_json:
        print_json(found.as_json())
    else:
        width = max(STDOUT.width, 100)
        for table in tables(found):
            print_page(table, width)
        for line in summary_lines(found):
            say(line)
        if plan:
            for line in plan_lines(found):
                say(line)
    _exit(found)


def _exit(found: Identified) -> Any:
    if found.problems:
        raise typer.Exit(ExitCode.INCOMPLETE)
