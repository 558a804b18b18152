"""One drive as a picture: speeds, both clutch torques and the output torque over time, with their 95 % bands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from dctorque_can.errors import DctorqueError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RPM = 60 / (2 * np.pi)
_TRUE = {"color": "0.62", "linewidth": 2.6, "label": "true"}
_ESTIMATED = {"linewidth": 1.0, "label": "estimated"}
_COLOURS = ("#1f6fb4", "#c8501e", "#2f7d32")
_BAND_95 = 1.96  # standard deviations


def drive_figure(estimates: NDArray[np.void], truth: NDArray[np.void] | None, title: str) -> Figure:
    """Draw a drive.

    Args:
        estimates: `ESTIMATE` ``[n]``, at least one row; no band where σ is NaN, not known.
        truth: rows of a simulation on the same time scale, or None.
        title: stands above the panels.

    Raises:
        DctorqueError: there are no estimates.
    """
    if not len(estimates):
        raise DctorqueError("there is nothing to draw: no estimates")
    figure = Figure(figsize=(9.6, 9.0), dpi=110, layout="constrained")
    axes = figure.subplots(4, 1, sharex=True, height_ratios=(1.15, 1, 1, 1))
    figure.suptitle(title, fontsize=12)
    start = int(estimates["t_us"][0] if truth is None else truth["t_us"][0])
    seconds = (estimates["t_us"] - start) / 1e6
    _speeds(axes[0], seconds, estimates)
    panels = (
        ("clutch1", "Clutch 1 torque [N·m]"),
        ("clutch2", "Clutch 2 torque [N·m]"),
        ("output", "Output torque [N·m]"),
    )
    for axis, (name, label), colour in zip(axes[1:], panels, _COLOURS, strict=True):
        torque, sigma = estimates[f"{name}_torque_nm"], estimates[f"{name}_sigma_nm"]
        if truth is not None:
            axis.plot((truth["t_us"] - start) / 1e6, truth[f"{name}_torque_nm"], **_TRUE)
        axis.plot(seconds, torque, color=colour, **_ESTIMATED)
        if (sigma > 0).any():
            _band(axis, seconds, torque, sigma, colour)
        axis.set_ylabel(label)
        axis.legend(loc="upper right", fontsize=9, framealpha=0.9)
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.margins(x=0)
    axes[-1].set_xlabel("Time [s]")
    return figure


def _band(
    axis: Axes, seconds: NDArray[np.float64], torque: NDArray[np.float64], sigma: NDArray[np.float64], colour: str
) -> None:
    """Shade the 95 % band; the torques alone decide what the axis shows."""
    shown = axis.get_ylim()
    half = _BAND_95 * sigma
    axis.fill_between(
        seconds, torque - half, torque + half, color=colour, alpha=0.25, linewidth=0, label="95 % band"
    )
    axis.set_ylim(shown)


def _speeds(axis: Axes, seconds: NDArray[np.float64], estimates: NDArray[np.void]) -> None:
    engine = estimates["engine_speed_rad_s"]
    shafts = (engine - estimates["clutch1_slip_rad_s"], engine - estimates["clutch2_slip_rad_s"])
    for shaft, (speed, colour) in enumerate(zip(shafts, _COLOURS, strict=False), start=1):
        axis.plot(seconds, speed * RPM, color=colour, linewidth=1.1, label=f"input shaft {shaft}")
    axis.plot(seconds, engine * RPM, color="0.15", linewidth=1.1, label="engine")
    axis.set_ylabel("Speed [rpm]")
    gears = axis.twinx()
    driving = np.where(estimates["phase2"] > estimates["phase1"], estimates["gear2"], estimates["gear1"])
    gears.step(seconds, driving, where="post", color="0.5", linewidth=0.9, linestyle=":")
    gears.set_ylabel("Gear of the tighter clutch", color="0.4", fontsize=9)
    gears.set_ylim(-0.3, 1.7 * max(int(driving.max(initial=1)), 2))  # leaves the top to the legend
    gears.yaxis.set_major_locator(MaxNLocator(integer=True))
    axis.legend(loc="upper right", fontsize=9, framealpha=0.9, ncols=3)
