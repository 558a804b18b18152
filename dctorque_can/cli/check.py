"""``dctorque check CONFIG``: is this vehicle file right, and what will the estimator get from the bus?"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dctorque_can.cli.console import STDERR, STDOUT, print_json, print_page, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import ForceOption, JsonOption, SetOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dctorque_can.config.load import Config
    from dctorque_can.config.problems import Problem
    from dctorque_can.evidence.recording import Judged


def check(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="Vehicle configuration (YAML).")],
    set_: SetOption = None,
    log: Annotated[
        list[Path] | None,
        typer.Option("--log", metavar="LOG", help="Recording of a drive to hold the file against; or several."),
    ] = None,
    fix: Annotated[
        Path | None,
        typer.Option("--fix", metavar="OUT", help="With --log: write the file with what is certain put right."),
    ] = None,
    plots: Annotated[
        Path | None,
        typer.Option("--plots", metavar="FOLDER", help="With --log: a picture of each finding into this folder."),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Check a vehicle configuration and its DBCs, and show the inputs; with --log also against a recorded drive.

    Exit codes: 0 the file can be used (warnings go to stderr), and nothing in the log contradicts it; 1 it has
    errors; 2 wrong usage; 3 the log contradicts it, or a part of the log cannot be read.
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
    if (fix or plots) and not log:
        raise typer.BadParameter("needs a recorded drive: --log LOG", param_hint="--fix" if fix else "--plots")
    if fix and overrides:
        raise typer.BadParameter(
            "corrects the file, not what --set lays over it: leave one out", param_hint="--fix"
        )
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
    if log:
        _against(loaded, log, found, _Wanted(fix, plots, force, as_json))
        return
    if as_json:
        print_json(found)
        return
    _show_problems(loaded.warnings)
    _show(loaded, found)


@dataclass(frozen=True)
class _Wanted:
    """What is made of the findings: a corrected file, pictures, JSON."""

    fix: Path | None
    plots: Path | None
    force: bool
    as_json: bool


def _against(config: Config, logs: Sequence[Path], found: dict[str, Any], wanted: _Wanted) -> None:
    """Hold the file against recordings, and show what contradicts it."""
    from dctorque_can.evidence.recording import judge
    from dctorque_can.logs.reader import open_log
    from dctorque_can.report.recording_lines import CONTRADICTS, finding_line, incomplete_lines, summary_line

    with ExitStack() as stack:
        readers = [stack.enter_context(open_log(path)) for path in logs]
        with progress_bar("replaying") as progress:
            judged = judge(readers, config, progress)
    incomplete = incomplete_lines(judged)
    for line in incomplete:
        warn(line)
    if not wanted.as_json:
        for finding in judged.findings:
            STDOUT.print(finding_line(finding), soft_wrap=True)
        STDOUT.print(summary_line(str(config.path), judged), markup=False, soft_wrap=True)
    more: dict[str, Any] = {}
    if wanted.plots:
        from dctorque_can.report.finding_plots import write_plots

        more["plots"] = [str(path) for path in write_plots(judged.findings, wanted.plots)]
        say(f"{wanted.plots}: {len(more['plots'])} pictures")
    if wanted.fix:
        more["fixed"] = _fix(config, judged, wanted.fix, wanted)
    if wanted.as_json:
        print_json(found | judged.as_json() | {"incomplete": incomplete} | more)
    if incomplete or any(finding.severity in CONTRADICTS for finding in judged.findings):
        raise typer.Exit(ExitCode.INCOMPLETE)


def _fix(config: Config, judged: Judged, path: Path, wanted: _Wanted) -> dict[str, Any]:
    """Write the corrected file, hold it against the same recordings, and show what is left."""
    from dctorque_can.config.load import load_config
    from dctorque_can.evidence.fixed_file import write_fixed
    from dctorque_can.evidence.recording import judge_frames
    from dctorque_can.report.recording_lines import finding_line, fixed_lines

    fixed = write_fixed(config, judged.findings, path, wanted.force)
    left = judge_frames(judged.frames, load_config(path))
    if not wanted.as_json:
        for line in fixed_lines(fixed, left):
            STDOUT.print(line, markup=False, soft_wrap=True)
        for finding in left:
            STDOUT.print("  ", finding_line(finding), soft_wrap=True)
    changes = [{"key": edit.key, "value": edit.value, "why": edit.comment} for edit in fixed.changes]
    return {"file": str(path), "changes": changes, "findings": [finding.as_json() for finding in left]}


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
    if config.of_class:
        print_page(
            Text(f"{len(config.of_class)} numbers are those of the class of the car, and not its own"), width
        )
    STDOUT.print(f"{config.path}: {counted(config.warnings)}", markup=False, soft_wrap=True)
