"""The records of the loop in `core`: its rules, which never change, and its state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import GEARS, STANDARD_GRAVITY
from dctorque_can.driveline.phase_decision import NEVER, closing_band
from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.pipeline.direction import DIRECTION, first_direction
from dctorque_can.pipeline.driving_shaft import DRIVING_SHAFT, first_driving_shaft
from dctorque_can.pipeline.one_gear_state import ONE_GEAR, first_one_gear
from dctorque_can.pipeline.samples import N_QUANTITIES, Signs
from dctorque_can.pipeline.settings import Settings
from dctorque_can.pipeline.thresholds import CAPACITY_MARGIN, PLAUSIBLE_WHEEL_SPEED, WIDEST
from dctorque_can.plausibility.state import CAR, car

RULES = np.dtype(
    [
        ("minimum", "f8", (N_QUANTITIES,)),
        ("maximum", "f8", (N_QUANTITIES,)),
        ("timeout_us", "i8", (N_QUANTITIES,)),
        ("learns_timeout", "u1", (N_QUANTITIES,)),  # … or it is learned (`intervals`)
        ("delay_us", "i8", (N_QUANTITIES,)),
        ("longest_delay_us", "i8"),
        ("estimate_period_us", "i8"),
        ("health_period_us", "i8"),
        ("max_gap_us", "i8"),
        ("max_step_back_us", "i8"),
        ("ratio", "f8", (GEARS,)),  # total, by gear number + 1; 0 where there is no such gear
        ("shaft", "i8", (GEARS,)),  # 1 or 2
        ("engage_tolerance", "f8"),
        ("release_tolerance", "f8"),
        ("confirm_us", "i8"),
        ("min_wheel_speed", "f8"),
        ("direction_measured", "u1"),  # the direction that the bus tells is not taken from gear or lever
        ("one_gear", "u1"),  # one gear signal for the whole gearbox (`one_gear`)
        ("phase_source", "i8", (2,)),
        ("closed_above", "f8", (2,)),  # positions and commands, in the direction of closing
        ("open_below", "f8", (2,)),
        ("closing_sign", "f8", (2,)),
        ("touches_before", "f8", (2,)),  # before ``closed_above``; 0: never
        ("slip_locked", "f8"),
        ("slip_released", "f8"),
        ("lock_time_us", "i8"),
        ("inertia", "f8"),  # of the car at the wheel, kg·m²
        ("weight", "f8"),  # … and the torque at the wheel of a vertical road, N·m
        ("efficiency", "f8"),  # of gears and final drive
        ("heats", "u1", (2,)),  # the vehicle file has the clutch's thermal data
        ("heat_capacity", "f8", (2,)),  # J/K
        ("cooling", "f8", (2,)),  # W/K
        ("coolant", "f8", (2,)),  # °C
        ("car", CAR),
    ],
    align=True,
)
"""What the loop must know besides the estimator."""

CORE = np.dtype(
    [
        ("arrived_us", "i8"),  # time of the latest frame; NEVER before the first
        ("frame_ok", "u1"),  # the frame at hand has a usable sample
        ("gear_candidate", "i8", (2,)),
        ("candidate_us", "i8", (2,)),
        ("slip_small_us", "i8", (2,)),  # since when the slip is small
        ("one_gear", ONE_GEAR),
        ("implausible_us", "i8"),  # since when shaft and wheel speed disagree, NEVER if they agree
        ("estimate_us", "i8"),
        ("health_us", "i8"),
        ("status", "u4"),  # of the last estimate
        ("sampled_us", "i8", (N_QUANTITIES,)),  # time of the last usable sample, where the timeout is learned
        ("interval_us", "i8", (N_QUANTITIES,)),  # … the median between two of them
        ("intervals", "i8", (N_QUANTITIES,)),  # … of so many
        ("direction", DIRECTION),
        ("driving_shaft", DRIVING_SHAFT),
    ],
    align=True,
)
"""State of the loop, apart from inputs and estimator."""


def rules(settings: Settings) -> NDArray[np.void]:
    """Return the `RULES` record ``[1]``."""
    record = np.zeros(1, RULES)
    r = record[0]
    r["minimum"][:], r["maximum"][:] = -WIDEST, WIDEST
    for item in settings.inputs:
        r["minimum"][item.quantity] = max(item.minimum, -WIDEST)
        r["maximum"][item.quantity] = min(item.maximum, WIDEST)
        r["timeout_us"][item.quantity] = item.timeout_us + item.delay_us  # counted from when it was taken
        r["learns_timeout"][item.quantity], r["delay_us"][item.quantity] = item.learns_timeout, item.delay_us
    r["longest_delay_us"] = max((item.delay_us for item in settings.inputs), default=0)
    r["estimate_period_us"] = settings.estimate_period_us
    r["health_period_us"] = settings.health_period_us
    r["max_gap_us"] = settings.max_gap_us
    r["max_step_back_us"] = settings.max_step_back_us
    for gear in settings.vehicle.gears:
        r["ratio"][gear.number + 1], r["shaft"][gear.number + 1] = gear.total_ratio, gear.shaft
    vehicle, chassis = settings.vehicle, settings.vehicle.chassis
    r["inertia"] = chassis.inertia_kgm2
    r["weight"] = chassis.mass_kg * STANDARD_GRAVITY * chassis.wheel_radius_m
    r["efficiency"] = vehicle.gear_efficiency * vehicle.final_drive_efficiency
    inference, phases = settings.gear_inference, settings.phases
    if settings.one_gear is not None:
        r["one_gear"], inference = True, settings.one_gear.by_ratio
    r["direction_measured"] = settings.direction_measured
    r["min_wheel_speed"] = PLAUSIBLE_WHEEL_SPEED
    if inference is not None:
        r["engage_tolerance"] = inference.engage_tolerance
        r["release_tolerance"] = inference.release_tolerance
        r["confirm_us"] = inference.confirm_us
        r["min_wheel_speed"] = inference.min_wheel_speed_rad_s
    for i, clutch in enumerate(phases.clutches):
        r["phase_source"][i] = clutch.source
        r["closing_sign"][i], r["closed_above"][i], r["open_below"][i] = closing_band(clutch)
        r["touches_before"][i] = clutch.touches_before
    r["slip_locked"] = phases.slip_locked_rad_s
    r["slip_released"] = phases.slip_released_rad_s
    r["lock_time_us"] = phases.lock_time_us
    for i, thermal in enumerate(clutch.thermal for clutch in settings.vehicle.clutches):
        if thermal is not None:
            r["heats"][i] = True
            r["heat_capacity"][i] = thermal.heat_capacity_j_per_k
            r["cooling"][i] = thermal.cooling_w_per_k
            r["coolant"][i] = thermal.coolant_c
    record["car"] = car(settings.vehicle, settings.driven_axle)
    return record


def first_inputs(settings: Settings, inputs: NDArray[np.void]) -> None:
    """Make ``inputs``, a `contract.INPUTS` ``[1]`` of zeros, what it is before the first frame."""
    r = inputs[0]
    for item in settings.inputs:
        r["mapped"][item.quantity] = True
        r["delay_us"][item.quantity] = item.delay_us
        r["signs"][item.quantity] = item.signs
        r["magnitudes"] |= item.signs is not Signs.SIGNED
    r["heading"] = r["direction"] = 1
    r["driven_axle"], r["step_us"] = settings.driven_axle, settings.step_us
    r["infer_gears"] = settings.gear_inference is not None
    r["one_gear"] = settings.one_gear is not None
    sources = {clutch.source for clutch in settings.phases.clutches}
    r["phases_told"] = not sources & {PhaseSource.NONE, PhaseSource.STATE}
    inputs["gear_unsure"] = settings.one_gear is not None
    limits = [CAPACITY_MARGIN * clutch.static_capacity_nm for clutch in settings.vehicle.clutches]
    r["torque_limit"] = limits
    r["output_limit"] = max(abs(g.total_ratio) for g in settings.vehicle.gears) * sum(limits)
    inputs["t_us"] = inputs["seen_us"] = NEVER
    inputs["closed"] = inputs["fits"] = True


def first_core(core: NDArray[np.void]) -> None:
    """Make ``core``, a `CORE` ``[1]`` of zeros, what it is before the first frame."""
    times = ("arrived_us", "candidate_us", "slip_small_us", "implausible_us", "estimate_us", "health_us")
    for name in (*times, "sampled_us"):
        core[name] = NEVER
    first_direction(core["direction"])
    first_driving_shaft(core["driving_shaft"])
    first_one_gear(core["one_gear"])
