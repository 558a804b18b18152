"""Noise against lag over the bandwidths of an observer, as a picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from numpy.typing import NDArray

from dctorque_can.design.conditions import pair_name
from dctorque_can.errors import DctorqueError

_COLOURS = ("#1f6fb4", "#c8501e")


def design_figure(report: Mapping[str, Any]) -> Figure:
    """Draw the sweep of what `judgement.Design.report` found, with the ``name`` of the vehicle."""
    sweep = report["sweep"]
    names = ("clutch1_torque_nm", "clutch2_torque_nm")
    columns = ([sweep[key][name] for name in names] for key in ("noise_nm", "lag_nm"))
    noise, lag = (np.array(column, np.float64).T for column in columns)  # None becomes a gap
    return noise_lag_figure(
        np.array(sweep["factors"]),
        noise,
        np.abs(lag),
        sweep["largest_factor_allowed"],
        f"{report['name']}, gears {pair_name((sweep['gear1'], sweep['gear2']))}: noise against lag",
        report["hand_over_nm_per_s"],
    )


def noise_lag_figure(
    factors: NDArray[np.float64],
    noise_nm: NDArray[np.float64],
    lag_nm: NDArray[np.float64],
    refused_from: float,
    title: str,
    rate_nm_per_s: float,
) -> Figure:
    """Draw the standard deviation of the noise and the error of lag of both clutch torques.

    Args:
        factors: ``[n]``, bandwidth over the chosen one, ascending.
        noise_nm: ``[n, 2]``, standard deviation of T_c1 and T_c2, N·m.
        lag_nm: ``[n, 2]``, largest error of T_c1 and T_c2 while torque is handed over, N·m, positive.
        refused_from: factors above this make a design that is refused.
        title: stands above the panel.
        rate_nm_per_s: of the hand-over.

    Raises:
        DctorqueError: no factor has noise or lag: the observer is unstable with all of them.
    """
    if not np.any(noise_nm > 0.0) and not np.any(lag_nm > 0.0):
        raise DctorqueError("there is nothing to draw: the observer is unstable with all of these bandwidths")
    figure = Figure(figsize=(8.2, 4.7), dpi=110, layout="constrained")
    axis = figure.subplots()
    figure.suptitle(title, fontsize=12)
    for clutch, colour in enumerate(_COLOURS):
        name = f"clutch {clutch + 1}"
        axis.plot(factors, noise_nm[:, clutch], color=colour, linewidth=2.0, label=f"noise σ, {name}")
        label = f"lag at {rate_nm_per_s:g} N·m/s, {name}"
        axis.plot(factors, lag_nm[:, clutch], color=colour, linewidth=2.0, linestyle="--", label=label)
    axis.axvline(1.0, color="0.25", linewidth=1.2, linestyle=":")
    axis.annotate(
        "chosen",
        (1.0, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(4, -4),
        textcoords="offset points",
        va="top",
        color="0.25",
    )
    if refused_from < factors[-1]:
        axis.axvspan(max(refused_from, factors[0]), factors[-1], color="0.9", zorder=0)
        axis.annotate(
            "too fast for the step",
            (factors[-1], 0.0),
            xycoords=("data", "axes fraction"),
            xytext=(-4, 4),
            textcoords="offset points",
            ha="right",
            color="0.4",
        )
    axis.set_xscale("log")
    axis.set_yscale("log")
    shown = [f for f in (0.25, 0.5, 1.0, 2.0, 4.0) if factors[0] <= f <= factors[-1]]
    axis.xaxis.set_major_locator(FixedLocator(shown))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    for formatter in (axis.yaxis.set_major_formatter, axis.yaxis.set_minor_formatter):
        formatter(FuncFormatter(lambda y, _: f"{y:g}"))
    axis.margins(x=0)
    axis.set_xlabel("Bandwidths, times the chosen ones [–]")
    axis.set_ylabel("Error of the clutch torque [N·m]")
    axis.grid(alpha=0.3, which="both")
    axis.legend(loc="best", fontsize=9, framealpha=0.9)
    return figure
