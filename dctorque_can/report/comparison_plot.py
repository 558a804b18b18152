"""A comparison of estimators as a picture: RMS errors as bars, and how much of them the stated bands hold."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from dctorque_can.analysis.consistency import LEVELS
from dctorque_can.errors import DctorqueError

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

    from dctorque_can.analysis.comparison import Comparison

_TORQUES = {"clutch1_nm": "Clutch 1", "clutch2_nm": "Clutch 2", "output_nm": "Output shaft"}
_ALL, _SHIFTS = "#1f6fb4", "#c8501e"
_LEVEL_COLOURS = ("#2f7d32", "#7b4fa3", "#b8860b")
_FACE_OF_SHIFTS = "white"


def comparison_figure(comparisons: Mapping[str, Comparison], title: str) -> Figure:
    """Draw the figures of each variant by name; the picture is 900 pixels wide.

    Above, one panel per torque with its RMS error over everything and within shifts. Below, where a variant states
    standard deviations, the observed coverage of their bands beside the nominal one.

    Raises:
        DctorqueError: there is nothing to draw.
    """
    if not comparisons:
        raise DctorqueError("there is nothing to draw: no variants")
    stating = {name: found for name, found in comparisons.items() if found.everything.clutches is not None}
    rows = len(stating) * len(_TORQUES)
    heights = (1.3 + 0.42 * len(comparisons), *((1.0 + 0.26 * rows,) if rows else ()))
    figure = Figure(figsize=(9.0, 0.9 + sum(heights)), dpi=100, layout="constrained")
    figure.suptitle(title, fontsize=12)
    grid = figure.add_gridspec(len(heights), len(_TORQUES), height_ratios=heights)
    first: Axes | None = None
    for column, (torque, label) in enumerate(_TORQUES.items()):
        axis = figure.add_subplot(grid[0, column], sharey=first)
        _bars(axis, comparisons, torque)
        axis.set_title(label, fontsize=10, loc="left")
        if first is not None:
            axis.tick_params(labelleft=False)
        first = first or axis
    handles: list[Artist] = [Patch(color=_ALL, label="whole drive"), Patch(color=_SHIFTS, label="shifts ± 100 ms")]
    if rows:
        _coverage(figure.add_subplot(grid[1, :]), stating)
        handles += [
            _mark("0.3", "observed, whole drive"),
            _mark(_FACE_OF_SHIFTS, "observed, shifts"),
            Line2D([], [], color="0.3", label="nominal"),
        ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9)
    return figure


def _mark(face: str, label: str) -> Line2D:
    return Line2D([], [], color="0.3", marker="o", ls="none", markersize=6.5, markerfacecolor=face, label=label)


def _bars(axis: Axes, comparisons: Mapping[str, Comparison], torque: str) -> None:
    places = np.arange(len(comparisons))
    right = 0.0
    for offset, colour, part in ((-0.19, _ALL, "everything"), (0.19, _SHIFTS, "shifts")):
        for place, comparison in zip(places, comparisons.values(), strict=True):
            figures = getattr(comparison, part)
            if figures is None:
                continue
            rms = figures.torques[torque].rms_nm
            axis.barh(place + offset, rms, height=0.36, color=colour)
            axis.text(rms, place + offset, f" {rms:.3g}", va="center", fontsize=9)
            right = max(right, rms)
    axis.set_yticks(places, list(comparisons), fontsize=9)
    axis.set_ylim(len(comparisons) - 0.5, -0.5)
    axis.set_xlim(0.0, 1.25 * right if right else 1.0)
    axis.grid(axis="x", alpha=0.3)
    axis.set_axisbelow(True)
    axis.set_xlabel("RMS error [N·m]", fontsize=9)


def _coverage(axis: Axes, comparisons: Mapping[str, Comparison]) -> None:
    """Draw the nominal share of each band as a line, and the observed shares of each torque as marks."""
    labels: list[str] = []
    for level, colour in zip(LEVELS, _LEVEL_COLOURS, strict=True):
        axis.axvline(100 * level, color=colour, linewidth=1.4)
    for torque, label in _TORQUES.items():
        for name, comparison in comparisons.items():
            for offset, figures, face in (
                (-0.15, comparison.everything, None),
                (0.15, comparison.shifts, _FACE_OF_SHIFTS),
            ):
                bands = None if figures is None else figures.torques[torque].bands
                if bands is None:
                    continue
                for share, colour in zip(bands.coverage, _LEVEL_COLOURS, strict=True):
                    axis.plot(
                        100 * share,
                        len(labels) + offset,
                        marker="o",
                        markersize=6.5,
                        color=colour,
                        markerfacecolor=face or colour,
                        clip_on=False,
                        zorder=3,
                    )
            labels.append(f"{label}, {name}")
    axis.set_yticks(np.arange(len(labels)), labels, fontsize=9)
    axis.set_ylim(len(labels) - 0.5, -0.5)
    axis.set_xlim(0.0, 100.0)
    axis.set_xticks([0, 25, *(100 * level for level in LEVELS), 75])
    axis.grid(axis="y", alpha=0.3)
    axis.set_xlabel("Errors within the stated 50, 90 and 95 % band [%]: each mark belongs on its line", fontsize=9)
