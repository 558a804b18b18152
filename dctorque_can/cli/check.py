"""``dctorque check CONFIG``: is this vehicle file right, and what will the estimator get from the bus?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dctorque_can.cli.console import STDERR, STDOUT, print_json, print_page, say
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import JsonOption, SetOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dctorque_can.config.load import Config
    from dctorque_can.config.problems import Problem


def check(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="Vehicle configuration (YAML).")],
    set_: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Check a vehicle configuration and its DBCs, and show the inputs.

    Exit codes: 0 the file can be used (warnings go to stderr), 1 it has errors, 2 wrong usage.
    """
    from dctorque_can.config.load import ConfigError, load_config
    from dctorque_can.config.overrides import parse_overrides
    from dctorque_can.config.overview import overview
    from dctorque_can.report.inputs_table import counted
    from dctorque_can.resources import find_config

    try:
        overrides = parse_overrides(set_ or [])
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--set") from error
    path = find_config(config)
    try:
        loaded = load_config(path, overrides)
    except ConfigError as error:
        if as_json:
            print_json(overview(str(path), error.problems, None))
        else:
            _show_problems(error.problems)
            say(f"{path}: {counted(error.problems)}")
        raise typer.Exit(ExitCode.ERROR) from error
    found = overview(str(path), loaded.warnings, loaded)
    if as_json:
        print_json(found)
        return
    _show_problems(loaded.warnings)
    _show(loaded, found)


def _show_problems(problems: Sequence[Problem]) -> None:
    from dctorque_can.report.inputs_table import problem_line

    for problem in problems:
        STDERR.print(problem_line(problem))


def _show(config: Config, found: dict[str, Any]) -> None:
    from rich.text import Text

    from dctorque_can.report.inputs_table import PAGE_WIDTH, counted, inputs_table

    width = STDOUT.width if STDOUT.is_terminal else max(STDOUT.width, PAGE_WIDTH)
    table, hidden = inputs_table(config.name, found["inputs"], width)
    print_page(table, width)
    if hidden:
        say(f"a wider terminal (or --json) shows {', '.join(hidden)}")
    estimator = f"estimator {found['method']}; driven axle {config.settings.driven_axle.name.lower()}"
    files = ", ".join(config.documents)
    line = f"{estimator}; {len(config.database.messages)} DBC messages; read: {files}"
    print_page(Text(line), width)
    STDOUT.print(f"{config.path}: {counted(config.warnings)}", markup=False, soft_wrap=True)
