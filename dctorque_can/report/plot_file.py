"""Plots as files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dctorque_can.errors import DctorqueError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLOT_FORMATS = (".png", ".svg", ".pdf")
"""Suffixes of the formats that are written."""


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the suffix (.png, .svg, .pdf).

    Raises:
        DctorqueError: the file cannot be written.
    """
    try:
        figure.savefig(path)
    except OSError as error:
        raise DctorqueError(f"{path}: the plot cannot be written: {error.strerror}") from error
