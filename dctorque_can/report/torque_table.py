"""A table with one row per torque and estimator: figures of the whole drive beside those of the shifts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

TORQUE_NAMES = {"clutch1_nm": "clutch 1", "clutch2_nm": "clutch 2", "output_nm": "output shaft"}

WIDTH = 100
"""Columns of a terminal that these tables are made for."""

Cells = Callable[[Any], tuple[str, ...] | None]


def table() -> Table:
    """Return an empty table in the style of all of these."""
    return Table(box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False, collapse_padding=True)


def by_torque(
    headings: tuple[str, ...], units: tuple[str, ...], rows: Mapping[str, Mapping[str, Any]], cells: Cells
) -> Table:
    """Return the table.

    Args:
        headings: of the columns of each part.
        units: below them.
        rows: by name of the estimator, then ``all`` and ``shifts``, then the torque: what ``cells`` is given.
        cells: returns the text of each column, or None for no row.
    """
    filled = table()
    filled.add_column("torque", no_wrap=True)
    filled.add_column("variant", no_wrap=True)
    for part in ("all", "shifts"):
        for n, (heading, unit) in enumerate(zip(headings, units, strict=True)):
            above = part if n == 0 else ""
            filled.add_column(Text(f"{above}\n{heading}\n{unit}"), justify="right", no_wrap=True)
    for torque, name in TORQUE_NAMES.items():
        first = True
        for variant, parts in rows.items():
            whole = cells(parts["all"][torque])
            if whole is None:
                continue
            shifts = cells(parts["shifts"][torque]) if parts.get("shifts") else None
            row = (*whole, *(shifts or ("–",) * len(headings)))
            filled.add_row(name if first else "", Text(variant), *row)
            first = False
        filled.add_section()
    return filled
