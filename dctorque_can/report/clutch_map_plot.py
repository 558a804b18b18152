"""The maps of the clutches as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dctorque_can.errors import DctorqueError

_COLOURS = ("#1f6fb4", "#c8501e")


def map_figure(name: str, rows: NDArray[np.void]) -> Figure:
    """Draw the valid nodes with two standard deviations, what is not valid paler, and the touch points.

    Args:
        name: of the vehicle.
        rows: `CLUTCH_MAP` ``[n]``, one of each clutch.

    Raises:
        DctorqueError: nothing has been seen of any clutch.
    """
    if not any((row["samples"] > 0.0).any() for row in rows):
        raise DctorqueError("there is nothing to draw: no clutch slipped in a way that taught its map")
    figure = Figure(figsize=(8.2, 4.7), dpi=110, layout="constrained")
    axis = figure.subplots()
    figure.suptitle(f"{name}: torque of each clutch by what closes it", fontsize=12)
    for row in rows:
        colour = _COLOURS[row["clutch"] - 1]
        seen = row["samples"] > 0.0
        x, torque, sigma = row["actuation"], row["capacity_nm"], row["sigma_nm"]
        valid = seen & (row["valid"] > 0)
        axis.plot(x[seen], torque[seen], color=colour, alpha=0.35, linewidth=1.0)
        axis.errorbar(
            x[valid],
            torque[valid],
            2.0 * sigma[valid],
            color=colour,
            marker="o",
            markersize=3.5,
            linestyle="none",
            capsize=2,
            label=f"clutch {row['clutch']}, ± 2 σ",
        )
        if row["touch_valid"]:
            axis.errorbar(
                row["touch_point"], 0.0, xerr=2.0 * row["touch_sigma"], color=colour, marker="^", capsize=2
            )
    axis.set_xlabel("position, pressure or command, in the unit of the bus")
    axis.set_ylabel("torque, N·m")
    axis.grid(alpha=0.3)
    axis.legend(frameon=False)
    return figure
