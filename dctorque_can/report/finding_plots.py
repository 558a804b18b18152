"""What shows a finding of `check --log`, as a picture each."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from dctorque_can.errors import DctorqueError
from dctorque_can.report.plot_file import save_figure

if TYPE_CHECKING:
    from dctorque_can.evidence.findings import Finding, Picture

_LINES = ("#c8501e", "#1f6fb4", "#2f7d32", "#7b4ea3", "0.3", "#b8860b", "#008b8b")


def write_plots(findings: Sequence[Finding], folder: Path) -> list[Path]:
    """Write a picture of each finding that has one into a folder, and return their paths.

    Raises:
        DctorqueError: the folder or a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DctorqueError(f"{folder}: cannot be made: {error.strerror}") from error
    written = []
    for number, finding in enumerate(findings, start=1):
        if finding.picture is not None:
            path = folder / f"{number:02d}_{finding.key.replace('.', '_')}.png"
            save_figure(finding_figure(finding, finding.picture), path)
            written.append(path)
    return written


def finding_figure(finding: Finding, picture: Picture) -> Figure:
    """Draw one finding: what was recorded as points, what file and recording say as lines."""
    figure = Figure(figsize=(9.0, 5.4), dpi=110, layout="constrained")
    axes = figure.subplots()
    figure.suptitle(
        "\n".join(textwrap.wrap(f"{finding.key}: {finding.text}", 105)), fontsize=10, x=0.02, ha="left"
    )
    axes.plot(picture.x, picture.y, ".", color="0.6", markersize=2.5, label="recorded")
    for (name, x, y), colour in zip(picture.lines, _LINES * len(picture.lines), strict=False):
        axes.plot(x, y, color=colour, linewidth=1.6, label=name)
    axes.set_xlabel(picture.x_label)
    axes.set_ylabel(picture.y_label)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9, framealpha=0.9)
    return figure
