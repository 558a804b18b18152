"""How all figures look."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

TRUE = {"color": "0.6", "linewidth": 2.6}
THIN = {"linewidth": 1.1}
BLUE, RED, GREEN, VIOLET = "#1f6fb4", "#c8501e", "#2f7d32", "#7b3fa0"
RPM = 60 / (2 * np.pi)


def new_figure(rows: int, columns: int, title: str, height: float, **options: Any) -> tuple[Figure, NDArray[Any]]:
    """Return a figure as wide as a README, and its axes ``[rows, columns]``."""
    figure = Figure(figsize=(9.6, height), dpi=110, layout="constrained")
    figure.suptitle(title, fontsize=12)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    return figure, axes


def finish(axes: Sequence[Any], label: str = "Time [s]") -> None:
    """Name the time axis of the lowest panels, and let the curves fill their width."""
    for axis in axes:
        axis.set_xlabel(label)
        axis.margins(x=0)


def legend(axis: Any, **options: Any) -> None:
    """Put a legend."""
    axis.legend(**{"fontsize": 8.5, "framealpha": 0.9, "loc": "best", **options})
