"""What ``dctorque study`` found of a catalogue of manoeuvres, as tables."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rich.console import Group
from rich.table import Table
from rich.text import Text

from dctorque_can.report.torque_table import TORQUE_NAMES, table

if TYPE_CHECKING:
    from dctorque_can.study.catalogue_summary import CatalogueSummary

CATALOGUE_WIDTH = 110
"""Columns of a terminal that these tables are made for."""


def catalogue_tables(summary: CatalogueSummary) -> Group:
    """Return a table for each vehicle, what the bands hold in all, and what asks for too much trust."""
    parts: list[Text | Table] = []
    plan = summary.catalogue.plan
    for vehicle in plan.vehicles:
        title = (
            f"{vehicle}: clutch 1 / clutch 2 / output shaft over {plan.runs} draws, {plan.profile} signals;\n"
            "confidently wrong and 95 % band: the worst draw; RMS error and band: of valid estimates"
        )
        parts += [Text(title, style="italic"), _vehicle(summary, vehicle)]
    pooled = _three((100 * held if held is not None else None for held in summary.pooled.values()), ".1f")
    parts.append(Text(f"Within the 95 % band, of all valid estimates: {pooled} %"))
    for row, name in summary.beyond():
        figures = row.torques[name]
        held = "–" if figures.held_least is None else f"{100 * figures.held_least:.1f} %"
        where = f"{row.vehicle}, {row.drive}, {row.signals}, {TORQUE_NAMES[name]}"
        line = f"{where}: {figures.wrong_ms:.0f} ms, band {held}"
        if figures.episode is not None:
            e = figures.episode
            line += f"; draw {e['draw']} at {e['start_s']:.2f} s: {e['error_nm']:+.0f} N·m, σ {e['sigma_nm']:.1f}"
        parts.append(Text(line))
    return Group(*parts)


def _vehicle(summary: CatalogueSummary, vehicle: str) -> Table:
    filled = table()
    filled.add_column("drive", no_wrap=True)
    filled.add_column("signals", no_wrap=True)
    for heading in ("confidently wrong\nms", "RMS error\nN·m", "95 % band\n%", "valid\n%"):
        filled.add_column(heading, justify="right", no_wrap=True)
    before = ""
    for row in summary.rows:
        if row.vehicle != vehicle:
            continue
        torques = list(row.torques.values())
        filled.add_row(
            row.drive if row.drive != before else "",
            row.signals,
            _three((t.wrong_ms for t in torques), ".0f"),
            _three((t.rms_nm for t in torques), ".1f"),
            _three((None if t.held_least is None else 100 * t.held_least for t in torques), ".1f"),
            _three((100 * t.valid for t in torques), ".1f"),
        )
        before = row.drive
    return filled


def _three(values: Iterable[float | None], form: str) -> str:
    return " / ".join("–" if value is None else format(value, form) for value in values)
