"""``dctorque check CONFIG``: is this vehicle file right, and what will the estimator get from the bus?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from dctorque_can.cli.console import STDERR, STDOUT, print_json, say
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import JsonOption, SetOption

if TYPE_CHECKING:
    from dctorque_can.config.inputs import InputEntry
    from dctorque_can.config.load import Config
    from dctorque_can.config.problems import Problem

NO_ESTIMATE = "no valid estimate"
BRIDGED = "no valid estimate after half a second"
AXLE = "other wheel of the axle"
PHASE = "validity: clutch counts as closed"
RECORDED = "nothing (recorded only)"
HINT = "a weak measurement of the load"
RESIDUAL = "residual of the clutch torque"
LOST = {
    "engine_speed": NO_ESTIMATE,
    "engine_torque": NO_ESTIMATE,
    "shaft1_speed": NO_ESTIMATE,
    "shaft2_speed": NO_ESTIMATE,
    "wheel_speed_fl": AXLE,
    "wheel_speed_fr": AXLE,
    "wheel_speed_rl": AXLE,
    "wheel_speed_rr": AXLE,
    "gear1": NO_ESTIMATE,
    "gear2": NO_ESTIMATE,
    "clutch1_position": PHASE,
    "clutch2_position": PHASE,
    "clutch1_open": PHASE,
    "clutch2_open": PHASE,
    "clutch1_command": PHASE,
    "clutch2_command": PHASE,
    "acceleration": RECORDED,
    "grade": RECORDED,
    "brake": "mark of braking between clutches",
}
"""What is lost while an input is stale or missing, by quantity, with the 2014 observer."""

LOST_WITH_KALMAN = {name: BRIDGED for name, lost in LOST.items() if lost == NO_ESTIMATE} | {
    "acceleration": HINT,
    "grade": HINT,
    "brake": "allowance for what the brakes do; acceleration and grade",
}
"""What is another loss with the Kalman filter, whose model stands in for a while."""

PAGE_WIDTH = 160  # of a file or a pipe
COLUMNS: dict[str, tuple[tuple[Literal["left", "right"], bool], int]] = {
    "quantity": (("left", True), 0),
    "signal": (("left", True), 0),
    "to SI": (("left", False), 0),
    "range (SI)": (("left", True), 105),
    "period": (("right", True), 0),
    "timeout": (("right", True), 0),
    "protection": (("left", True), 145),
    "while missing": (("left", False), 125),
}
"""Heading to (justification, whether its text stays on one line), and the terminal width that it needs."""


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
            print_json(_report(str(path), error.problems, None))
        else:
            _show_problems(error.problems)
            say(f"{path}: {_counted(error.problems)}")
        raise typer.Exit(ExitCode.ERROR) from error
    if as_json:
        print_json(_report(str(path), loaded.warnings, loaded))
        return
    _show_problems(loaded.warnings)
    _show(loaded, _rows(loaded))


def _report(file: str, problems: tuple[Problem, ...], config: Config | None) -> dict[str, Any]:
    """Return everything for scripts; ``config`` is None when it has errors."""
    errors = [problem.as_json() for problem in problems if problem.severity == "error"]
    warnings = [problem.as_json() for problem in problems if problem.severity == "warning"]
    return {
        "file": file,
        "name": "" if config is None else config.name,
        "method": "" if config is None else _method(config),
        "ok": not errors,
        "errors": errors,
        "warnings": warnings,
        "inputs": [] if config is None else _rows(config),
    }


def _method(config: Config) -> str:
    """Return the estimator as the vehicle file calls it."""
    return config.settings.method.name.lower()


def _lost(name: str, config: Config) -> str:
    from dctorque_can.estimators.methods import Method

    with_kalman = LOST_WITH_KALMAN if config.settings.method is Method.KALMAN else {}
    return with_kalman.get(name, LOST[name])


def _show_problems(problems: tuple[Problem, ...]) -> None:
    for problem in problems:
        style = "red" if problem.severity == "error" else "yellow"
        place, _, rest = str(problem).partition(": ")
        STDERR.print(f"[{style}]{escape(place)}[/]: {escape(rest)}")


def _counted(problems: tuple[Problem, ...]) -> str:
    errors = sum(problem.severity == "error" for problem in problems)
    warnings = len(problems) - errors
    parts = [f"{errors} error{'s' if errors != 1 else ''}"] if errors else []
    parts += [f"{warnings} warning{'s' if warnings != 1 else ''}"] if warnings else []
    return ", ".join(parts) or "no errors"


def _rows(config: Config) -> list[dict[str, Any]]:
    """Return one row per input that is given, then one per quantity that is not."""
    from dctorque_can.pipeline.samples import Quantity

    given = {entry.input.quantity: entry for entry in config.entries}
    rows = [_row(entry, config) for _, entry in sorted(given.items())]
    phase_of_source = {q for q in Quantity if Quantity.CLUTCH1_POSITION <= q <= Quantity.CLUTCH2_COMMAND}
    for quantity in Quantity:
        if quantity not in given and quantity not in phase_of_source:
            rows.append(_missing_row(quantity.name.lower(), config))
    return rows


def _row(entry: InputEntry, config: Config) -> dict[str, Any]:
    protections = {protection.message: protection for protection in config.protections}
    periods = [period for period in entry.periods_ms if period]
    kinds = []
    for message in dict.fromkeys(term.message for term in entry.input.terms):
        protection = protections.get(message)
        kind = "none" if protection is None else protection.crc
        counted = protection is not None and protection.counter_signal
        kinds.append(f"{kind}, counter" if counted else kind)
    name = entry.input.quantity.name.lower()
    return {
        "quantity": name,
        "key": entry.key,
        "present": True,
        "signals": [f"{term.message}.{term.signal}" for term in entry.input.terms],
        "units": list(entry.units),
        "factors": [term.factor for term in entry.input.terms],
        "offsets": [term.offset for term in entry.input.terms],
        "mapped": [{str(raw): value for raw, value in term.values.items()} for term in entry.input.terms],
        "not_available": [sorted(term.not_available) for term in entry.input.terms],
        "minimum": entry.input.minimum,
        "maximum": entry.input.maximum,
        "period_ms": max(periods) if periods else None,
        "timeout_ms": entry.input.timeout_us / 1000,
        "delay_ms": entry.input.delay_us / 1000,
        "protection": kinds,
        "lost": RESIDUAL if entry.key.startswith("inputs.clutch") else _lost(name, config),
    }


def _missing_row(name: str, config: Config) -> dict[str, Any]:
    lost = _lost(name, config)
    if name.startswith("gear") and config.settings.gear_inference is not None:
        lost = "nothing: inferred from the ratio of shaft to wheel speed"
    if name in ("shaft1_speed", "shaft2_speed"):  # only the method kalman lets them be missing
        lost = "its slip and torque are known from engine and wheels alone"
    return {"quantity": name, "key": "", "present": False, "signals": [], "lost": lost}


def _show(config: Config, rows: list[dict[str, Any]]) -> None:
    width = STDOUT.width if STDOUT.is_terminal else max(STDOUT.width, PAGE_WIDTH)
    console = Console(width=width, highlight=False, emoji=False)
    columns = {name: kind for name, (kind, needed) in COLUMNS.items() if width >= needed}
    table = Table(title=f"{config.name}: inputs", title_justify="left", box=box.SIMPLE_HEAD)
    for heading, (justify, fixed) in columns.items():
        table.add_column(heading, justify=justify, no_wrap=fixed, overflow="fold")
    for row in rows:
        cells = _cells(row)
        style = None if row["present"] else "dim"
        table.add_row(*(escape(cells.get(heading, "")) for heading in columns), style=style)
    console.print(table)
    if len(columns) < len(COLUMNS):
        hidden = ", ".join(heading for heading in COLUMNS if heading not in columns)
        say(f"a wider terminal (or --json) shows {hidden}")
    files = ", ".join(name for name in config.documents)
    axle = config.settings.driven_axle.name.lower()
    estimator = f"estimator {_method(config)}; driven axle {axle}"
    console.print(f"{estimator}; {len(config.database.messages)} DBC messages; read: {files}", markup=False)
    console.print(f"{config.path}: {_counted(config.warnings)}", markup=False, soft_wrap=True)


def _cells(row: dict[str, Any]) -> dict[str, str]:
    """Return the text of each column of a row."""
    if not row["present"]:
        return {"quantity": row["quantity"], "signal": "not given", "while missing": row["lost"]}
    return {
        "quantity": row["quantity"],
        "signal": "\n".join(row["signals"]),
        "to SI": "\n".join(map(_conversion, row["units"], row["factors"], row["offsets"], row["mapped"])),
        "range (SI)": _range(row["minimum"], row["maximum"]),
        "period": f"{row['period_ms']:g} ms" if row["period_ms"] else "?",
        "timeout": f"{row['timeout_ms']:g} ms" + (f"\nlate {row['delay_ms']:g} ms" if row["delay_ms"] else ""),
        "protection": "\n".join(row["protection"]),
        "while missing": row["lost"],
    }


def _conversion(unit: str, factor: float, offset: float, mapped: dict[str, float]) -> str:
    if mapped:
        return " ".join(f"{raw}→{value:g}" for raw, value in mapped.items())
    text = f"{unit or 'as sent'} · {factor:.4g}" if factor != 1 else unit or "as sent"
    return text + (f" {offset:+.6g}" if offset else "")


def _range(minimum: float, maximum: float) -> str:
    from dctorque_can.config.inputs import ANY

    return "any" if (minimum, maximum) == ANY else f"{minimum:.5g} … {maximum:.5g}"
