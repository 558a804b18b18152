"""The records of the monitor: what it must know of a vehicle, and what it remembers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import AIR_DENSITY, GEARS, STANDARD_GRAVITY, DrivenAxle, Vehicle
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.plausibility.findings import N_FINDINGS

CAR = np.dtype(
    [
        ("ratio", "f8", (GEARS,)),  # total, by gear number + 1; 0 where there is no such gear
        ("shaft", "i8", (GEARS,)),  # 1 or 2
        ("one_axle", "u1"),  # one axle is driven, not all
        ("efficiency", "f8"),
        ("engine_inertia", "f8"),  # kg·m², with damper and clutch drums
        ("shaft_inertia", "f8", (2,)),  # kg·m², with gears
        ("inertia", "f8"),  # kg·m², of body and wheels at the wheel
        ("radius", "f8"),  # m
        ("weight", "f8"),  # N·m at the wheel, of a wall
        ("rolling", "f8"),  # N·m
        ("air", "f8"),  # N·m per (rad/s)²
    ],
    align=True,
)
"""What the monitor is told of the vehicle."""

MONITOR = np.dtype(
    [
        # the signals, smoothed
        ("t_us", "i8"),  # of the last look; NEVER: filters begin anew
        ("looks", "i8"),
        ("gear", "i8", (2,)),
        ("gear_us", "i8", (2,)),  # since when
        ("slip", "f8", (2,)),  # rad/s, of engine against shaft
        ("together_us", "i8", (2,)),  # since when engine and shaft turn alike, NEVER if they do not
        ("half_torque", "f8"),  # N·m, smoothed once
        ("half_w_e", "f8"),  # rad/s
        ("half_w_b", "f8"),
        ("torque", "f8"),  # smoothed twice
        ("w_e", "f8"),
        ("w_b", "f8"),
        ("last_w_e", "f8"),
        ("dw_e", "f8"),  # rad/s²
        ("dw_b", "f8"),
        ("axle_slip", "f8"),  # driven over undriven wheels − 1
        ("brake_us", "i8"),  # when the brake was last on
        # ratios
        ("ratio_xx", "f8", (GEARS,)),
        ("ratio_xy", "f8", (GEARS,)),
        ("ratio_s", "f8", (GEARS,)),
        ("in_gear_s", "f8"),
        ("crossed_s", "f8"),
        ("misread_s", "f8"),
        ("misread_gear", "i8"),
        # slip of the driven axle against acceleration
        ("axle", "f8", (6,)),  # sums of 1, x, y, xx, xy, yy
        ("axle_s", "f8"),
        # clutches
        ("ride", "f8", (2,)),  # rad/s of way of engine and shaft together
        ("ride_open", "f8", (2,)),  # … while the clutch is called open
        ("ride_crossed", "f8", (2,)),  # … and the other one closed
        ("closed_slides_s", "f8", (2,)),  # without a break, while the other one holds
        ("slide_s", "f8", (2,)),  # sliding beside the other one that holds
        ("slide_closed_s", "f8", (2,)),  # … while it is called closed
        ("rest_open_s", "f8"),
        ("rest_closed_s", "f8"),
        ("launch_s", "f8"),
        ("launch_open_s", "f8"),
        # torque against acceleration
        ("carrier", "i8"),  # clutch that has the engine's torque: 0, 1, none 2, unknown −1
        ("carrier_gear", "i8"),
        ("wait_us", "i8"),  # no equation before this
        ("mean", "f8", (3,)),
        ("sum_xx", "f8", (3,)),  # 11, 12, 22
        ("sum_xy", "f8", (2,)),
        ("sum_yy", "f8"),
        ("sum_s", "f8"),
        ("apart_s", "f8"),  # of these, with the engine turning apart from the car
        ("knows_body", "u1"),  # undriven wheels tell the speed of the body
        ("grade_m", "f8"),  # m of way on which the road load is known
        ("climb_m", "f8"),  # … and the height that it means
        ("idle_s", "f8"),
        ("idle_nms", "f8"),  # N·m·s
        # verdicts
        ("findings", "u4"),  # that stand
        ("strong", "u4"),  # of these, for which torques are not valid
        ("ever", "u4"),  # since the start
        ("finding_gear", "i8"),
        ("measured", "f8", (N_FINDINGS,)),
    ],
    align=True,
)
"""State of the monitor. Seconds and sums are of evidence, which fades."""


def car(vehicle: Vehicle, driven_axle: DrivenAxle) -> NDArray[np.void]:
    """Return the `CAR` record ``[1]``."""
    record = np.zeros(1, CAR)
    r = record[0]
    for gear in vehicle.gears:
        r["ratio"][gear.number + 1], r["shaft"][gear.number + 1] = gear.total_ratio, gear.shaft
    r["one_axle"] = driven_axle != DrivenAxle.ALL
    r["efficiency"] = vehicle.gear_efficiency * vehicle.final_drive_efficiency
    r["engine_inertia"] = vehicle.engine_inertia_kgm2 + vehicle.damper.inertia_kgm2
    r["shaft_inertia"] = [vehicle.shaft_inertia_kgm2(shaft) for shaft in (1, 2)]
    r["inertia"] = vehicle.chassis.inertia_kgm2
    chassis = vehicle.chassis
    r["weight"] = chassis.mass_kg * STANDARD_GRAVITY * chassis.wheel_radius_m
    r["rolling"] = chassis.rolling_resistance * r["weight"]
    r["air"] = 0.5 * AIR_DENSITY * chassis.drag_coefficient * chassis.frontal_area_m2 * chassis.wheel_radius_m**3
    r["radius"] = vehicle.chassis.wheel_radius_m
    return record


def first(monitor: NDArray[np.void]) -> None:
    """Make ``monitor``, a `MONITOR` ``[1]`` of zeros, what it is before the first frame."""
    monitor["t_us"] = monitor["gear_us"] = monitor["together_us"] = monitor["brake_us"] = NEVER
    monitor["carrier"] = -1
