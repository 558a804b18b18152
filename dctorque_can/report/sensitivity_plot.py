"""The ranking of a study as a picture: one panel per torque, one bar per factor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from dctorque_can.errors import DctorqueError
from dctorque_can.report.study_tables import label
from dctorque_can.report.torque_table import TORQUE_NAMES

if TYPE_CHECKING:
    from dctorque_can.study.summary import StudySummary

MOST_BARS = 10
_SIGNIFICANT, _CHANCE = "#1f6fb4", "0.78"


@dataclass(frozen=True, slots=True)
class SensitivityPanel:
    """The bars of one torque; arrays ``[factor]`` with the greatest change first, N·m.

    Attributes:
        title: stands above the panel.
        labels: of the bars.
        change: length of the bars.
        low: lower end of the confidence interval.
        high: upper end.
        significant: false for a bar that chance could have made.
        shapes: where the error is great: ↑ at large values of the factor, ↓ at small ones, ∪ at both, ∩ between.
    """

    title: str
    labels: Sequence[str]
    change: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    significant: NDArray[np.bool_]
    shapes: Sequence[str]


def sensitivity_figure(panels: Sequence[SensitivityPanel], title: str) -> Figure:
    """Draw the longest bars of every panel; it is 900 pixels wide.

    Raises:
        DctorqueError: there is nothing to draw.
    """
    bars = [min(MOST_BARS, len(panel.labels)) for panel in panels]
    if not bars or not all(bars):
        raise DctorqueError("there is nothing to draw: no factors")
    figure = Figure(figsize=(9.0, 1.3 + sum(0.9 + 0.24 * n for n in bars)), dpi=100, layout="constrained")
    axes = figure.subplots(len(panels), 1, squeeze=False, height_ratios=[2.0 + n for n in bars])[:, 0]
    figure.suptitle(title, fontsize=12)
    for axis, panel, n in zip(axes, panels, bars, strict=True):
        change, shown = panel.change[:n], panel.significant[:n]
        places = np.arange(n)
        axis.barh(places, change, height=0.7, color=np.where(shown, _SIGNIFICANT, _CHANCE))
        axis.hlines(places[shown], panel.low[:n][shown], panel.high[:n][shown], color="0.1", linewidth=1.4)
        right = float(max(panel.high[:n].max(), np.finfo(float).tiny))
        for place in range(n):
            end, shape = (panel.high[place], f" {panel.shapes[place]}") if shown[place] else (change[place], "")
            axis.text(end + 0.012 * right, place, f"{change[place]:.2g}{shape}", va="center", fontsize=9)
        if more := len(panel.labels) - n:
            remark = f"{more} more factor{'s' if more > 1 else ''} below {change[-1]:.2g} N·m"
            axis.text(0.99, 0.04, remark, transform=axis.transAxes, ha="right", fontsize=9, color="0.35")
        axis.set_yticks(places, panel.labels[:n], fontsize=9)
        axis.invert_yaxis()
        axis.set_xlim(0.0, 1.12 * right)
        axis.grid(axis="x", alpha=0.3)
        axis.set_axisbelow(True)
        axis.set_title(panel.title, fontsize=10, loc="left")
        axis.set_xlabel("Change of the RMS error over the middle 90 % of the factor's draws [N·m]", fontsize=9)
    figure.legend(
        handles=[
            Patch(
                color=_SIGNIFICANT, label="significant: worse ↑ with more, ↓ with less, ∪ at both ends, ∩ between"
            ),
            Line2D([], [], color="0.1", linewidth=1.4, label="90 % confidence"),
            Patch(color=_CHANCE, label="no more than chance"),
        ],
        loc="outside lower center",
        ncols=3,
        fontsize=9,
    )
    return figure


def study_figure(summary: StudySummary) -> Figure:
    """Draw the ranking of every torque of a study that has one."""
    plan = summary.study.plan
    title = (
        f"{summary.study.config.name}: {plan.drive} drive, {plan.profile} signals, {summary.used} cars\n"
        f"What moves the RMS error of the method {summary.method}"
    )
    return sensitivity_figure([_panel(summary, torque) for torque in TORQUE_NAMES], title)


def _panel(summary: StudySummary, torque: str) -> SensitivityPanel:
    ranking = summary.ranking(torque)
    rms = summary.rms[torque]
    title = (
        f"{TORQUE_NAMES[torque].capitalize()}: nominal {summary.nominal[torque]:.3g}, median {rms['p50']:.3g}, "
        f"95 % below {rms['p95']:.3g} N·m; {100 * summary.sensitivities[torque].explained:.0f} % explained"
    )
    return SensitivityPanel(
        title=title,
        labels=[label(summary.study, name) for name, _ in ranking],
        change=np.array([effect.change for _, effect in ranking]),
        low=np.array([effect.low for _, effect in ranking]),
        high=np.array([effect.high for _, effect in ranking]),
        significant=np.array([effect.significant for _, effect in ranking]),
        shapes=[effect.shape for _, effect in ranking],
    )
