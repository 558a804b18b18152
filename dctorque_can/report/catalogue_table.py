"""What ``dctorque study`` found of a catalogue of manoeuvres, as tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from rich.console import Group
from rich.table import Table
from rich.text import Text

from dctorque_can.report.torque_table import TORQUE_NAMES, table
from dctorque_can.study.catalogue_smoothed import MOST_SHARE

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
    if summary.smoothing:
        parts += [Text("Smoothed, all drives together", style="italic"), _smoothing(summary)]
        parts += [Text(line) for line in _worse(summary)]
    return Group(*parts)


def _smoothing(summary: CatalogueSummary) -> Table:
    filled = table()
    filled.add_column("", no_wrap=True)
    for name in summary.smoothing:
        filled.add_column(TORQUE_NAMES[name], justify="right", no_wrap=True)
    found = list(summary.smoothing.values())
    filled.add_row("RMS error over that online", *(_or_dash(s.share, ".2f") for s in found))
    filled.add_row("… in the worst drive", *(_or_dash(s.worst, ".2f") for s in found))
    more = f"drives more than {100 * (MOST_SHARE - 1):.0f} % worse"
    filled.add_row(more, *(f"{s.worse} of {s.drives}" for s in found))
    filled.add_row("95 % band, all, %", *(_or_dash(s.held and 100 * s.held, ".1f") for s in found))
    filled.add_row("… least, %", *(_or_dash(s.held_least and 100 * s.held_least, ".1f") for s in found))
    wrong = (f"{s.wrong_ms:.0f}, {s.wrong_online_ms:.0f}" for s in found)
    filled.add_row("confidently wrong, smoothed and online, ms", *wrong)
    return filled


def _worse(summary: CatalogueSummary) -> Iterator[str]:
    for name, found in summary.smoothing.items():
        if found.worse and found.worst_case is not None:
            case = found.worst_case
            where = f"{case['vehicle']}, {case['drive']}, {case['signals']}, draw {case['draw']}"
            yield f"worst of {TORQUE_NAMES[name]}: {where}"


def _or_dash(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)


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
    return " / ".join(_or_dash(value, form) for value in values)
