"""Error figures as a table for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rich.table import Table

from dctorque_can.report.torque_table import TORQUE_NAMES

if TYPE_CHECKING:
    from dctorque_can.analysis.errors import ErrorFigures


def errors_table(errors: Mapping[str, ErrorFigures], title: str) -> Table:
    """Return one row per torque, in N·m."""
    table = Table(title=title, title_justify="left")
    table.add_column("Torque")
    for name in ("RMS error [N·m]", "bias [N·m]", "peak [N·m]"):
        table.add_column(name, justify="right")
    for name, figures in errors.items():
        row = (f"{figures.rms:.2f}", f"{figures.bias:+.2f}", f"{figures.peak:.1f}")
        table.add_row(TORQUE_NAMES.get(name, name), *row)
    return table
