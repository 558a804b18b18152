"""Sections 2.1 to 2.3: both driveline models open loop (as Fig. 4), and torque recirculation in a tie-up."""

from __future__ import annotations

import numpy as np
from cases import CARS, car, paper_truth, rms, table
from drawing import BLUE, RED, RPM, THIN, TRUE, finish, legend, new_figure
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dctorque_can.analysis.shifts import Shift, find_shifts
from dctorque_can.simulation.open_loop import DrivelineModel, run_open_loop
from dctorque_can.simulation.tie_up import tie_up

BEFORE, AFTER = 300, 500  # ms around a shift
LOOKS = {DrivelineModel.CONVENTIONAL: (RED, "conventional"), DrivelineModel.COMPLIANT: (BLUE, "compliant")}
COMPARED = {
    "engine_speed_rad_s": "engine speed [rad/s]",
    "clutch1_torque_nm": "clutch 1 [N·m]",
    "clutch2_torque_nm": "clutch 2 [N·m]",
    "output_torque_nm": "output shaft [N·m]",
}
SPEED_M_S, ENGINE_NM, PRESSED_NM = 6.0, 60.0, 120.0  # of the tie-up


def window(truth: NDArray[np.void], shift: Shift) -> NDArray[np.void]:
    """Return the rows around a shift."""
    return truth[max(0, shift.start - BEFORE) : shift.end + AFTER]


def validation() -> tuple[dict[str, Figure], str]:
    """Run both models through one up- and one down-shift of both cars, from the plant's state before the shift."""
    figures, rows = {}, []
    for name, label in CARS.items():
        vehicle, truth = car(name).settings.vehicle, paper_truth(name)
        shifts = find_shifts(truth)
        pair = (next(s for s in shifts if s.is_up), next(s for s in shifts if not s.is_up))
        figure, axes = new_figure(
            4, 2, f"Open loop, {label}: both models on the inputs of the reference plant", 9.4, sharex="col"
        )
        for column, shift in enumerate(pair):
            part = window(truth, shift)
            t = part["t_us"] / 1e6
            runs = {model: run_open_loop(vehicle, model, part) for model in DrivelineModel}
            draw_shift(axes[:, column], t, part, runs)
            kind = "up" if shift.is_up else "down"
            axes[0, column].set_title(f"{kind}-shift {shift.from_gear} → {shift.to_gear}", fontsize=10)
            for model, run in runs.items():
                errors = [f"{rms(run[f] - part[f]):.2f}" for f in COMPARED]
                rows.append([f"{label}, {kind}-shift, {LOOKS[model][1]}", *errors])
        legend(axes[0, 0])
        finish(axes[-1])
        figures[f"open_loop_{name}"] = figure
    head = ["RMS of model − plant, from 0.3 s before to 0.5 s after the shift", *COMPARED.values()]
    return figures, table(head, rows)


def draw_shift(axes, t, truth, runs) -> None:
    panels = (
        ("engine_speed_rad_s", "Engine speed [rpm]", RPM),
        ("clutch1_torque_nm", "Clutch 1 torque [N·m]", 1.0),
        ("clutch2_torque_nm", "Clutch 2 torque [N·m]", 1.0),
        ("output_torque_nm", "Output torque [N·m]", 1.0),
    )
    for axis, (field, label, factor) in zip(axes, panels, strict=True):
        axis.plot(t, factor * truth[field], label="reference plant", **TRUE)
        draw_models(axis, t, runs, field, factor)
        axis.set_ylabel(label)


def draw_models(axis, t, runs, field: str, factor: float = 1.0) -> None:
    """Draw a column of both models, the dashed conventional one on top: where they coincide it shows as dashes."""
    for model in (DrivelineModel.COMPLIANT, DrivelineModel.CONVENTIONAL):
        colour, name = LOOKS[model]
        style = (0, (4, 4)) if model is DrivelineModel.CONVENTIONAL else "-"
        axis.plot(t, factor * runs[model][field], linestyle=style, color=colour, label=name, **THIN)


def recirculation() -> tuple[dict[str, Figure], str]:
    """Press the second clutch against the locked first one, in the plant and in both models."""
    figure, axes = new_figure(
        4,
        2,
        f"Tie-up in gears 1 and 2: clutch 1 locked, clutch 2 pressed to {PRESSED_NM:.0f} N·m "
        f"against {ENGINE_NM:.0f} N·m of engine torque",
        9.4,
        sharex="col",
    )
    rows = []
    for column, (name, label) in enumerate(CARS.items()):
        vehicle = car(name).settings.vehicle
        truth = tie_up(vehicle, SPEED_M_S, ENGINE_NM, PRESSED_NM)
        t = truth["t_us"] / 1e6
        runs = {model: run_open_loop(vehicle, model, truth) for model in DrivelineModel}
        axes[0, column].set_title(label, fontsize=10)
        panels = (
            ("clutch1_torque_nm", "Clutch 1 (locked) [N·m]"),
            ("clutch2_torque_nm", "Clutch 2 (slips) [N·m]"),
            ("transfer1_torque_nm", "Transfer shaft 1 [N·m]"),
            ("output_torque_nm", "Output torque [N·m]"),
        )
        for axis, (field, text) in zip(axes[:, column], panels, strict=True):
            axis.plot(t, truth[field], label="reference plant", **TRUE)
            draw_models(axis, t, runs, field)
            axis.axhline(0.0, color="0.3", linewidth=0.7)
            if column == 0:
                axis.set_ylabel(text)
        held = slice(500, 900)
        known = [truth[f"{name}_torque_nm"][held] for name in ("clutch1", "transfer1")]
        rows.append(
            [f"{label}, plant", f"{known[0].mean():.1f}", f"{known[0].min():.1f}", f"{known[1].mean():.0f}", ""]
        )
        for model, run in runs.items():
            difference = rms(run["output_torque_nm"][held] - truth["output_torque_nm"][held])
            rows.append(
                [
                    f"{label}, {LOOKS[model][1]}",
                    f"{run['clutch1_torque_nm'][held].mean():.1f}",
                    f"{run['clutch1_torque_nm'][held].min():.1f}",
                    f"{run['transfer1_torque_nm'][held].mean():.0f}",
                    f"{difference:.0f}",
                ]
            )
    legend(axes[0, 0])
    finish(axes[-1])
    head = [
        "while clutch 2 is pressed",
        "mean clutch 1 [N·m]",
        "lowest clutch 1 [N·m]",
        "mean transfer shaft 1 [N·m]",
        "RMS error of output torque [N·m]",
    ]
    return {"recirculation": figure}, table(head, rows)
