"""What ``dctorque study`` found, as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from dctorque_can.analysis.consistency import LEVELS
from dctorque_can.pipeline.estimates import SENSORS
from dctorque_can.report.torque_table import TORQUE_NAMES, by_torque, table
from dctorque_can.study.coverage import HONEST

if TYPE_CHECKING:
    from dctorque_can.study.coverage import EstimatorSpread, TorqueSpread
    from dctorque_can.study.plan import Study
    from dctorque_can.study.summary import StudySummary


def estimator_tables(summary: StudySummary) -> Group:
    """Return what both methods are worth, at most 100 columns wide."""
    tables = _estimators(summary.estimators)
    return Group(*(part for title, filled in tables for part in (Text(title, style="italic"), filled)))


def label(study: Study, name: str) -> str:
    """Return a factor with the range that it is drawn from."""
    low, high = study.vary[name].limits
    return f"{name}  {low:g} … {high:g}"


def _estimators(found: dict[str, EstimatorSpread]) -> Iterator[tuple[str, Table]]:
    """Yield tables with their titles."""
    if not found:
        return
    rows: dict[str, dict[str, Any]] = {name: spread.parts for name, spread in found.items()}
    yield (
        "RMS error of the drawn cars, and the median of its ratio to that of the bound",
        by_torque(("median", "90 %", "worst", "/bound"), ("N·m", "N·m", "N·m", ""), rows, _rms_cells),
    )
    headings = (*(f"{level:.0%}" for level in LEVELS), f"≥ {HONEST:.0%}", "least")
    yield (
        "Errors within the stated bands of all cars together (nominal: the heading);\n"
        f"cars in which the 95 % band holds at least {100 * HONEST:.0f} %, and the least that it holds in one",
        by_torque(headings, ("%", "%", "%", "cars", "%"), rows, _band_cells),
    )
    yield (
        "Confidently wrong: valid, but beyond 5 σ and 10 N·m (output 100 N·m); for so long in all and in one car",
        by_torque(("all cars", "worst"), ("ms", "ms"), rows, _wrong_cells),
    )
    yield "Mean NIS of each speed (1 is right), and that of the cars in the middle 80 %", _nis_table(found)


def _rms_cells(spread: TorqueSpread) -> tuple[str, ...]:
    return (*(f"{rms:.2f}" for rms in (spread.median, spread.p90, spread.worst)), f"{spread.over_bound:.2f}")


def _band_cells(spread: TorqueSpread) -> tuple[str, ...] | None:
    held = spread.coverage
    if held is None:
        return None
    cars = f"{held.honest * spread.runs:.0f}/{spread.runs}"
    return (*(f"{100 * share:.1f}" for share in held.pooled), cars, f"{100 * held.least[-1]:.1f}")


def _wrong_cells(spread: TorqueSpread) -> tuple[str, ...] | None:
    held = spread.coverage
    return None if held is None else (f"{held.wrong_ms:.0f}", f"{held.wrong_worst_ms:.0f}")


def _nis_table(found: dict[str, EstimatorSpread]) -> Table:
    filled = table()
    filled.add_column("variant", no_wrap=True)
    for sensor in SENSORS:
        filled.add_column(sensor.replace("_", " "), justify="right", no_wrap=True)
    for name, spread in found.items():
        if spread.sensors:
            cells = (spread.sensors.get(sensor) for sensor in SENSORS)
            filled.add_row(name, *(f"{s.mean:.2f} ({s.p10:.2f}…{s.p90:.2f})" if s else "–" for s in cells))
    return filled


def quantile_table(summary: StudySummary) -> Table:
    """Return the RMS error of the configured method: of the nominal car, and its quantiles over the others."""
    plan = summary.study.plan
    failed = f", {len(summary.failed)} failed" if summary.failed else ""
    title = (
        f"{summary.study.config.name}: RMS error of {summary.method} [N·m], {plan.drive} drive, "
        f"{plan.profile} signals, {plan.runs} runs{failed}"
    )
    table = Table(title=title, title_justify="left")
    table.add_column("Torque")
    for heading in ("nominal", "5 %", "50 %", "95 %"):
        table.add_column(heading, justify="right")
    for torque, name in TORQUE_NAMES.items():
        figures = (summary.nominal[torque], *summary.rms.get(torque, {}).values())
        table.add_row(name, *(f"{figure:.2f}" for figure in figures))
    return table


def ranking_table(summary: StudySummary) -> Table:
    """Return the change of the RMS error per factor and torque; chance in brackets."""
    title = f"Change of the RMS error of {summary.method} over each factor's range [N·m]"
    table = Table(title=title, title_justify="left")
    table.add_column("Factor")
    for name in TORQUE_NAMES.values():
        table.add_column(name, justify="right")
    effects = {torque: dict(summary.ranking(torque)) for torque in TORQUE_NAMES}
    for factor, _ in summary.ranking("clutch1_nm"):
        cells = [effects[torque][factor] for torque in TORQUE_NAMES]
        if any(effect.significant for effect in cells):
            shown = (
                f"{e.change:.2f} {e.shape}" if e.significant else f"[dim]({e.change:.2f})  [/]" for e in cells
            )
            table.add_row(label(summary.study, factor), *shown)
    table.caption = (
        "worse ↑ with more, ↓ with less, ∪ at both ends, ∩ in between; in brackets: no more than chance; "
        "factors that are so for every torque are left out"
    )
    table.caption_justify = "left"
    return table
