"""The inputs of a vehicle file as a table, and what is wrong in it as lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from rich import box
from rich.markup import escape
from rich.table import Table

from dctorque_can.config.inputs import ANY
from dctorque_can.config.problems import Problem

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


def inputs_table(name: str, rows: Sequence[dict[str, Any]], width: int) -> tuple[Table, list[str]]:
    """Return the rows of `overview.input_rows` as a table, and the columns for which ``width`` has no place."""
    columns = {heading: kind for heading, (kind, needed) in COLUMNS.items() if width >= needed}
    table = Table(title=f"{name}: inputs", title_justify="left", box=box.SIMPLE_HEAD)
    for heading, (justify, fixed) in columns.items():
        table.add_column(heading, justify=justify, no_wrap=fixed, overflow="fold")
    for row in rows:
        cells = _cells(row)
        style = None if row["present"] else "dim"
        table.add_row(*(escape(cells.get(heading, "")) for heading in columns), style=style)
    return table, [heading for heading in COLUMNS if heading not in columns]


def problem_line(problem: Problem) -> str:
    """Return one problem with its place in the colour of its severity, as markup."""
    style = "red" if problem.severity == "error" else "yellow"
    place, _, rest = str(problem).partition(": ")
    return f"[{style}]{escape(place)}[/]: {escape(rest)}"


def counted(problems: Sequence[Problem]) -> str:
    """Return how many errors and warnings these are, in words."""
    errors = sum(problem.severity == "error" for problem in problems)
    warnings = len(problems) - errors
    parts = [f"{errors} error{'s' if errors != 1 else ''}"] if errors else []
    parts += [f"{warnings} warning{'s' if warnings != 1 else ''}"] if warnings else []
    return ", ".join(parts) or "no errors"


def _cells(row: dict[str, Any]) -> dict[str, str]:
    """Return the text of each column of a row."""
    if not row["present"]:
        return {"quantity": row["quantity"], "signal": "not given", "while missing": row["lost"]}
    conversions = map(_conversion, row["units"], row["factors"], row["offsets"], row["mapped"])
    signal, conversion, of_multiplier = _multiplied(row["multiplier"])
    own = row["timeout_ms"]
    timeout = (own if isinstance(own, str) else f"{own:g} ms") + of_multiplier
    rate = "" if row["most_per_s"] is None else f"≤ {row['most_per_s']:.4g}/s"
    if row["valid_if"] is not None:
        values = " or ".join(map(str, row["valid_if"]["values"]))
        signal.append(f"if {row['valid_if']['signal']} = {values}")
        timeout += f"\nif {row['valid_if']['timeout_ms']:g} ms"
    return {
        "quantity": row["quantity"],
        "signal": "\n".join([*row["signals"], *signal, *row["taken_from"]]),
        "to SI": "\n".join([*conversions, *conversion]),
        "range (SI)": "\n".join(filter(None, (_range(row["minimum"], row["maximum"]), rate, row["sign"]))),
        "period": f"{row['period_ms']:g} ms" if row["period_ms"] else "?",
        "timeout": timeout + (f"\nlate {row['delay_ms']:g} ms" if row["delay_ms"] else ""),
        "protection": "\n".join(row["protection"]),
        "while missing": row["lost"],
    }


def _multiplied(multiplier: dict[str, Any] | None) -> tuple[list[str], list[str], str]:
    """Return the lines of a multiplier in the columns of signal, conversion and timeout."""
    if multiplier is None:
        return [], [], ""
    sign = "÷" if multiplier["divides"] else "×"
    conversion = _conversion(multiplier["unit"], multiplier["factor"], multiplier["offset"], {})
    return [f"{sign} {multiplier['signal']}"], [conversion], f"\n{sign} {multiplier['timeout_ms']:g} ms"


def _conversion(unit: str, factor: float, offset: float, mapped: dict[str, float]) -> str:
    if mapped:
        return " ".join(f"{raw}→{value:g}" for raw, value in mapped.items())
    text = f"{unit or 'as sent'} · {factor:.4g}" if factor != 1 else unit or "as sent"
    return text + (f" {offset:+.6g}" if offset else "")


def _range(minimum: float, maximum: float) -> str:
    return "any" if (minimum, maximum) == ANY else f"{minimum:.5g} … {maximum:.5g}"
