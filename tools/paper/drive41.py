"""Section 4.1: the drive of Fig. 6, the estimates of Fig. 7, Table 1 and what its variants and limits are."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from cases import (
    MANY_SEEDS,
    SEEDS,
    TORQUES,
    Score,
    car,
    estimate,
    frames_of,
    on_rows,
    paper_frames,
    paper_truth,
    score,
    table,
)
from drawing import BLUE, GREEN, RED, RPM, THIN, TRUE, VIOLET, finish, legend, new_figure
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from dctorque_can.analysis.shifts import find_shifts
from dctorque_can.config.load import Config
from dctorque_can.simulation.drive import Drive, simulate
from dctorque_can.simulation.sensors import LABORATORY, PRODUCTION, Noise

KMH = 3.6
PRINTED = ["2.124", "3.403", "67.233"]
PANELS = ("Clutch 1 torque [N·m]", "Clutch 2 torque [N·m]", "Output torque [N·m]")
UIO = ("clutch1_torque_uio_nm", "clutch2_torque_uio_nm", "output_torque_nm")
NEAR = 0.25  # s around a shift in the close-ups
SEARCH = ((0.35, 0.03, 0.0), (0.7, 0.06, 150.0), (0.45, 0.0, 0.0), (0.6, 0.08, 0.0))  # throttle, grade, payload
WHEEL_POLES, SPEED_POLES, CROSSOVERS = (100, 150, 200, 250, 300), (200, 300, 400, 500), (60, 100, 150, 200)
GENERIC = {
    "acceleration_bandwidth_rad_s": 100,
    "engine_bandwidth_rad_s": 200,
    "shaft_bandwidth_rad_s": 200,
    "torque_crossover_rad_s": 100,
}  # the defaults of a production bus


def drive() -> tuple[dict[str, Figure], str]:
    """Draw the drive, as Fig. 6, and the estimates, as Fig. 7."""
    truth = paper_truth()
    t = truth["t_us"] / 1e6
    figure, axes = new_figure(5, 1, "The drive of section 4.1 (compare Fig. 6)", 10.0, sharex=True)
    throttle, a, b, c, d = axes[:, 0]
    throttle.plot(t, 100 * truth["pedal"], color="0.2", label="throttle", **THIN)
    throttle.set_ylabel("Throttle [%]")
    a.plot(t, truth["engine_torque_nm"], color=GREEN, label="engine, net", **THIN)
    a.set_ylabel("Torque [N·m]")
    for i, colour in ((1, BLUE), (2, RED)):
        b.plot(t, truth[f"clutch{i}_position_mm"], color=colour, label=f"clutch {i}", **THIN)
        c.plot(t, RPM * truth[f"shaft{i}_speed_rad_s"], color=colour, label=f"input shaft {i}", **THIN)
    b.axhline(3.0, color="0.5", linestyle=":", linewidth=1.0, label="kissing point")
    b.set_ylabel("Actuator position [mm]")
    c.plot(t, RPM * truth["engine_speed_rad_s"], color="0.15", label="engine", **THIN)
    c.set_ylabel("Speed [rpm]")
    r_w = car("paper_car").settings.vehicle.chassis.wheel_radius_m
    d.plot(t, KMH * r_w * truth["undriven_wheel_speed_rad_s"], color="0.2", label="vehicle speed", **THIN)
    d.set_ylabel("Vehicle speed [km/h]")
    for axis in (throttle, a, b, c, d):
        legend(axis, loc="upper right")
    finish([d])
    return {"drive": figure, "estimates": estimates()}, ""


def estimates() -> Figure:
    """Draw the estimates over the drive and close to both shifts."""
    truth = paper_truth()
    rows = estimate(car("paper_car"), paper_frames(1))
    figure, axes = new_figure(
        3, 3, "Full observer on 1 kHz signals with noise (compare Fig. 7)", 8.4, width_ratios=(1.5, 1, 1)
    )
    t, te = truth["t_us"] / 1e6, rows["t_us"] / 1e6
    shifts = find_shifts(truth)
    up, down = next(s for s in shifts if s.is_up), next(s for s in shifts if not s.is_up)
    spans = [(t[0], t[-1]), *((t[s.start] - NEAR, t[s.end] + NEAR) for s in (up, down))]
    titles = (
        "whole drive",
        f"up-shift {up.from_gear} → {up.to_gear}",
        f"down-shift {down.from_gear} → {down.to_gear}",
    )
    for column, ((start, end), title) in enumerate(zip(spans, titles, strict=True)):
        axes[0, column].set_title(title, fontsize=10)
        shown, seen = (t >= start) & (t <= end), (te >= start) & (te <= end)
        for axis, field, label, colour in zip(axes[:, column], TORQUES, PANELS, (BLUE, RED, GREEN), strict=True):
            axis.plot(t[shown], truth[field][shown], label="true", **TRUE)
            axis.plot(te[seen], rows[field][seen], color=colour, label="estimated", linewidth=0.9)
            if column == 0:
                axis.set_ylabel(label)
                legend(axis, loc="upper right")
        finish([axes[2, column]])
        for axis in axes[:, column]:
            axis.margins(x=0)
    return figure


def all_frames(profile=LABORATORY):
    """Return the frames of all seeds."""
    return {seed: paper_frames(seed, profile) for seed in SEEDS}


def table1() -> tuple[dict[str, Figure], str]:
    """Hold Table 1 against ours."""
    frames = {seed: paper_frames(seed) for seed in MANY_SEEDS}
    truth = paper_truth()
    peaks = [f"{np.abs(truth[f]).max():.0f}" for f in TORQUES]
    ours = score(car("paper_car"), frames, truth)
    rows = [
        ["the paper, Table 1 (peaks 140, 265, 2500)", *PRINTED],
        [f"ours, full observer (peaks {', '.join(peaks)})", *ours.cells()],
        ["… lowest to highest", *(f"{x.min():.2f} … {x.max():.2f}" for x in ours.rms.T)],
        [
            f"… seeds at or below Table 1, of {len(frames)}",
            *(str(int(np.sum(x <= float(limit)))) for x, limit in zip(ours.rms.T, PRINTED, strict=True)),
        ],
    ]
    return {}, table(["RMS error [N·m]", "clutch 1", "clutch 2", "output shaft"], rows)


def gains() -> tuple[dict[str, Figure], str]:
    """Search the gains on drives of the same shift, none of them the paper's."""
    vehicle = car("paper_car").settings.vehicle
    drives = []
    for k, (pedal, grade, payload) in enumerate(SEARCH):
        pedals = ((0.7, 0.0), (0.7, pedal), (5.5, pedal), (5.5, 0.0))
        road = Drive(f"search{k}", 14.0, pedal=pedals, grade_rad=((0.0, grade),), payload_kg=payload)
        truth = simulate(vehicle, road)
        drives.append((truth, frames_of(truth, "paper_car", LABORATORY, 40 + k)))
    found = []
    for numbers in product(WHEEL_POLES, SPEED_POLES, CROSSOVERS):
        config = with_gains(*numbers)
        errors = np.mean([score(config, {0: frames}, truth).rms[0] for truth, frames in drives], axis=0)
        found.append((max(errors / np.array(PRINTED, dtype=float)), numbers, errors))
    found.sort(key=lambda one: one[0])
    rows = []
    for worst, numbers, errors in [*found[:5], found[-1]]:
        on_the_papers = score(with_gains(*numbers), all_frames(), paper_truth()).rms.mean(axis=0)
        cells = (" / ".join(f"{x:.2f}" for x in three) for three in (errors, on_the_papers))
        rows.append([" / ".join(str(number) for number in numbers), f"{worst:.3f}", *cells])
    head = [
        "wheel acceleration / engine and shaft / crossover [rad/s]: the best five and the worst",
        "largest ratio to Table 1",
        "RMS on the search drives [N·m]",
        "RMS on the paper's drive [N·m]",
    ]
    return {}, table(head, rows)


def with_gains(wheel: int, speed: int, crossover: int) -> Config:
    """Return the section 4.1 car with three bandwidths in rad/s."""
    return car(
        "paper_car",
        acceleration_bandwidth_rad_s=wheel,
        engine_bandwidth_rad_s=speed,
        shaft_bandwidth_rad_s=speed,
        torque_crossover_rad_s=crossover,
    )


def variants() -> tuple[dict[str, Figure], str]:
    """Switch one thing at a time."""
    frames, truth = all_frames(), paper_truth()
    full = "full observer"
    scores: dict[str, Score] = {full: score(car("paper_car"), frames, truth)}
    scores["unknown input observers alone"] = score(car("paper_car", sub_observer="unknown_input"), frames, truth)
    changes = {
        "no attenuation before the kissing point": {"phase_gating": False},
        "road_load: flat": {"road_load": "flat"},
        "road_load: none": {"road_load": "none"},
        "road_load: none, no attenuation": {"road_load": "none", "phase_gating": False},
        "rate law as printed in rows 1, 2 of A": {"printed_rate_law": True},
        "gains of a production bus": GENERIC,
    }
    for name, change in changes.items():
        scores[name] = score(car("paper_car", **change), frames, truth)
    rows = [[name, *one.cells()] for name, one in scores.items()]
    figure, axes = new_figure(
        1, 3, "RMS error on the paper's drive, one thing changed at a time", 4.0, sharey=True
    )
    names = list(scores)[::-1]
    for column, (axis, label) in enumerate(zip(axes[0], ("Clutch 1", "Clutch 2", "Output shaft"), strict=True)):
        values = [scores[name].rms[:, column].mean() for name in names]
        colours = [BLUE if name == full else "0.65" for name in names]
        places = range(len(names))
        axis.scatter(values, places, color=colours, zorder=3)
        axis.set_yticks(places, names)
        axis.axvline(float(PRINTED[column]), color=RED, linestyle="--", linewidth=1.2, label="Table 1")
        axis.set_xscale("log")
        axis.set_xlim(0.6 * min(values), 4.5 * max(values))
        axis.set_ylim(-0.6, len(names) - 0.4)
        for place, value in enumerate(values):
            text = f"{value:.1f}" if value < 100 else f"{value:.0f}"
            axis.text(
                0.98, place, text, transform=axis.get_yaxis_transform(), va="center", ha="right", fontsize=8.5
            )
        axis.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.set_xlabel(f"{label} [N·m]")
        axis.tick_params(axis="y", labelsize=8)
    legend(axes[0, 0], loc=(0.36, 0.88))
    return {"variants": figure}, table(["RMS error [N·m]", "clutch 1", "clutch 2", "output shaft"], rows)


def limits() -> tuple[dict[str, Figure], str]:
    """Take one source of error away at a time, down to what the observer's own model leaves."""
    truth = paper_truth()
    clean = replace(LABORATORY, noise=Noise(0.0, 0.0, 0.0))
    fast = {
        "acceleration_bandwidth_rad_s": 500,
        "engine_bandwidth_rad_s": 500,
        "shaft_bandwidth_rad_s": 500,
        "torque_crossover_rad_s": 500,
    }
    once, late = {1: paper_frames(1, clean)}, {1: paper_frames(1, replace(clean, torque_delay_us=10_000))}
    gained = all_frames(replace(LABORATORY, torque_gain=1.03))
    offset = all_frames(replace(LABORATORY, torque_offset_nm=5.0))
    on_a_bus = all_frames(PRODUCTION)
    cases = {
        "as in Table 1": score(car("paper_car"), all_frames(), truth),
        "without noise": score(car("paper_car"), once, truth),
        "without noise, all poles at 500 rad/s": score(
            car("paper_car", **fast), {1: paper_frames(1, clean)}, truth
        ),
        "… and the engine torque 10 ms late": score(car("paper_car", **fast), late, truth),
        "with noise, nominal engine torque 3 % high": score(car("paper_car"), gained, truth),
        "with noise, nominal engine torque 5 N·m high": score(car("paper_car"), offset, truth),
        "production CAN": score(car("paper_car"), on_a_bus, truth),
        "production CAN, gains of a production bus": score(car("paper_car", **GENERIC), on_a_bus, truth),
    }
    rows = [[name, *(one.cells() if len(one.rms) > 1 else single(one))] for name, one in cases.items()]
    return {}, table(["RMS error [N·m]", "clutch 1", "clutch 2", "output shaft"], rows)


def single(one: Score) -> list[str]:
    """Return the figures of one run."""
    return [f"{value:.2f}" if value < 10 else f"{value:.1f}" for value in one.rms[0]]


def cruise() -> tuple[dict[str, Figure], str]:
    """Show what (47) sees at constant speed: without a known road load, nothing."""
    config = car("paper_car")
    road = Drive(
        "cruise",
        70.0,
        speed_m_s=((0.0, 0.0), (2.0, 0.0), (22.0, 20.0), (70.0, 20.0)),
        grade_rad=((45.0, 0.0), (47.0, 0.03)),
    )
    truth = simulate(config.settings.vehicle, road)
    frames = frames_of(truth, "paper_car", LABORATORY, 1)
    figure, axes = new_figure(
        2,
        1,
        "Cruising at 72 km/h, a 3 % hill from 45 s: the adaptive output torque (47) by road_load",
        5.6,
        sharex=True,
    )
    upper, lower = axes[:, 0]
    upper.plot(truth["t_us"] / 1e6, truth["output_torque_nm"], label="true", **TRUE)
    rows, smooth = [], 200
    for name, colour in (("none", RED), ("flat", VIOLET), ("learned", BLUE)):
        seen = estimate(car("paper_car", road_load=name), frames)
        t = seen["t_us"] / 1e6
        mean = np.convolve(seen["output_torque_adaptive_nm"], np.ones(smooth) / smooth, "same")
        t, mean, seen = (column[smooth:-smooth] for column in (t, mean, seen))
        upper.plot(t, mean, color=colour, label=name, **THIN)
        error = mean - on_rows(seen, truth, "output_torque_nm")
        lower.plot(t, error, color=colour, label=name, **THIN)
        spans = [(t > 30) & (t < 44), (t > 50) & (t < 69)]
        rows.append([f"road_load: {name}", *(f"{error[span].mean():.1f}" for span in spans)])
    upper.set_ylabel("Output torque [N·m]")
    lower.set_ylabel("Error [N·m]")
    lower.set_ylim(-400, 400)
    legend(upper, loc="upper right", ncols=4, title="mean over 0.2 s", title_fontsize=8.5)
    finish([lower])
    return {"cruise": figure}, table(["mean error of the adaptive output torque [N·m]", "level", "3 % hill"], rows)
