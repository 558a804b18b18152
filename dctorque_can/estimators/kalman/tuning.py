"""The numbers of the Kalman filter beside its discrete model: noises, rates, and what follows from the vehicle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import AIR_DENSITY, GEARS, STANDARD_GRAVITY, Vehicle
from dctorque_can.estimators.kalman.design import KalmanDesign
from dctorque_can.estimators.kalman.lasting import deviations
from dctorque_can.estimators.kalman.model import GAIN_SHARE, arms, lasting_errors, tyre_damping
from dctorque_can.estimators.kalman.tape import ERRORS

LEAST_NOISE = 0.25  # of a configured variance, beside its resolution: sensors may have half the noise
RATIO_AGAIN = 0.0003  # share by which a ratio is another one the next time: the gear has not changed, its load has
OPEN_RATE = 50.0  # N·m/s, of an open clutch's torque
SPEEDS = 7  # engine, both input shafts, each wheel for itself
SLIDING = 12.0  # rad/s of slip from which friction neither locks nor turns, late and noisy as the speeds are

TUNING = np.dtype(
    [
        ("rate", "f8", (3,)),  # N·m/s, largest standard deviation of a clutch torque's rate by `ClutchPhase`
        ("sliding_rate", "f8"),  # … of one that slips by more than `SLIDING`, or hands over to one that does
        ("steady_rate", "f8"),  # … of a locked clutch while nothing happens
        ("rate_time", "f8"),  # s, for how long a rate lasts
        ("settling", "f8"),  # s, in which a rate falls back to the steady one
        ("neutral", "f8", (2,)),  # N·m, of a synchroniser's torque on each shaft
        ("neutral_rate", "f8", (2,)),  # N·m/s
        ("grip", "f8"),  # N·m, largest torque of the driven tyres
        ("fastest_grip", "f8"),  # rad/s², of the driven wheels against the body, unless they slip
        ("tyre_damping", "f8"),  # N·m·s/rad, of the driven wheels against the body (`model`)
        ("tyre_share", "f8"),  # of a clutch torque's rate at the wheel that the tyres' torque has on its own
        ("road_load", "f8"),  # N·m/√s
        ("held_load", "f8"),  # … when the car stops or brakes, while the brakes change
        ("open_torque", "f8"),  # N·m, of an open clutch around its drag
        ("touch_torque", "f8"),  # … that may touch, at its kissing point
        ("drag", "f8", (2,)),  # N·m per rad/s of slip
        ("drag_error", "f8"),  # … by how much it may be another
        ("spin_loss", "f8", (3, 2)),  # of input shafts and output shaft: N·m, and N·m per rad/s
        ("spins_freely", "u1"),  # none is told
        ("spin_loss_error", "f8", (2,)),  # by how much those of an input shaft may be others
        ("speed_variance", "f8", (SPEEDS,)),  # of one sample: engine, input shafts, wheels FL, FR, RL, RR
        ("least_noise", "f8", (5,)),  # share of it that is always believed; both axles' wheels alike
        ("told_noise", "f8", (5,)),  # rad/s, standard deviation as configured
        ("rounding", "f8", (5,)),  # (rad/s)², variance of the resolution
        ("timing_error", "f8"),  # s, between the sample of a speed and its frame's time
        ("gate", "f8"),  # largest normalised innovation squared that is believed
        ("patience_us", "i8"),  # … until one has not been for so long
        ("engine_error", "f8"),  # N·m, at no torque
        ("engine_share", "f8"),  # … and by how much it grows with the torque, beside
        ("scale_error", "f8"),  # share by which all wheels, and each ratio, lastingly are others than told
        ("ratio_error", "f8"),  # … of a gear that has not been in yet
        ("ratio_again", "f8"),  # … by how much it may be another one when its gear is in once more
        ("delay_error", "f8"),  # s
        ("gain_error", "f8"),  # … the share of the torque that it lastingly is
        ("lag_error", "f8"),  # s
        ("engine_lag", "f8"),  # s, of the engine behind its nominal torque
        ("engine_delay", "f8"),  # rad/s per N·m, what a change that comes late does to the engine speed
        ("parameter_error", "f8"),  # relative, of mass, inertias and stiffnesses
        ("lasting", "f8", (ERRORS,)),  # standard deviations of `lasting`
        ("acceleration_error", "f8"),  # m/s²
        ("grade_error", "f8"),  # rad
        ("command_share", "f8"),  # relative error of a clutch command; NaN: not used
        ("command_error", "f8"),  # … and N·m
        ("command_lag", "f8"),  # s
        ("command_time", "f8"),  # s, for how long that error counts
        ("inertial_time", "f8"),  # s, … and those of acceleration and grade
        ("mass_arm", "f8"),  # r m, kg·m
        ("rolling_torque", "f8"),  # N·m at the wheel
        ("air_torque", "f8"),  # N·m per (rad/s)²
        ("J_b", "f8"),  # of the body with the undriven wheels
        ("J_b_wheels", "f8"),  # … of these alone
        ("J_e", "f8"),
        ("fastest_engine", "f8"),  # rad/s², both clutches at their capacity
        ("ratio", "f8", (2, GEARS)),  # total, by shaft and gear number + 1
        ("synchroniser_ratio", "f8", (2,)),  # mean of each shaft's gears
        ("synchroniser_torque", "f8"),  # N·m, standard deviation of one that may or may not pull
        ("loss_span", "f8", (2, GEARS)),  # by how much the ratio of torques differs between driving and driven
        ("transfer_twist", "f8", (2, GEARS)),  # rad in the transfer shaft per N·m of output torque
        ("output_twist", "f8"),  # … in the output shaft
    ],
    align=True,
)
"""What the filter must know beside its tables."""


def speed_variances(design: KalmanDesign) -> list[float]:
    """Return the variance of one sample of each speed, (rad/s)²: noise, and rounding to the resolution."""
    noises = [design.engine_speed_noise_rad_s, *2 * [design.shaft_speed_noise_rad_s]]
    noises += 4 * [design.wheel_speed_noise_rad_s]
    return [sigma**2 + q**2 / 12.0 for sigma, q in zip(noises, design.speed_resolutions_rad_s, strict=True)]


def tuning(vehicle: Vehicle, design: KalmanDesign) -> NDArray[np.void]:
    """Return the `TUNING` record ``[1]`` of a vehicle and a design."""
    t = np.zeros(1, TUNING)
    t["rate"] = (OPEN_RATE, design.slipping_torque_rate_nm_per_s, design.locked_torque_rate_nm_per_s)
    t["sliding_rate"] = design.sliding_torque_rate_nm_per_s
    t["steady_rate"] = design.steady_torque_rate_nm_per_s
    t["rate_time"] = design.torque_rate_time_s
    t["settling"] = design.settling_time_s
    t["tyre_share"] = design.tyre_torque_share
    t["road_load"] = design.road_load_rate_nm_per_sqrt_s
    t["held_load"] = design.held_load_rate_nm_per_sqrt_s
    t["open_torque"] = design.open_torque_nm
    t["touch_torque"] = design.touch_torque_nm
    t["drag_error"] = design.open_drag_error_nms_per_rad
    t["drag"] = [clutch.drag_nms_per_rad for clutch in vehicle.clutches]
    t["spin_loss"] = [(s.spin_loss_nm, s.spin_loss_nms_per_rad) for s in (*vehicle.shafts, vehicle.output_shaft)]
    t["spins_freely"] = not t["spin_loss"].any()
    t["spin_loss_error"] = design.spin_loss_error_nm, design.spin_loss_error_nms_per_rad
    t["speed_variance"] = variances = speed_variances(design)
    rounding = [q**2 / 12.0 for q in design.speed_resolutions_rad_s]
    least = [max(LEAST_NOISE, known / all_noise) for known, all_noise in zip(rounding, variances, strict=True)]
    t["least_noise"] = [*least[:3], *2 * [max(least[3:])]]
    t["told_noise"] = [
        design.engine_speed_noise_rad_s,
        *2 * [design.shaft_speed_noise_rad_s],
        *2 * [design.wheel_speed_noise_rad_s],
    ]
    t["rounding"] = [*rounding[:3], *2 * [max(rounding[3:])]]
    t["gate"] = design.gate_sigma**2
    t["patience_us"] = round(design.gate_patience_s * 1e6)
    t["timing_error"] = design.timing_error_s
    t["engine_error"] = design.engine_torque_error_nm
    t["engine_share"] = math.sqrt(1.0 - GAIN_SHARE) * design.engine_torque_error_share
    t["gain_error"], t["lag_error"] = lasting_errors(design)
    t["scale_error"], t["ratio_error"] = design.wheel_scale_error_share, design.ratio_error_share
    t["ratio_again"] = min(RATIO_AGAIN, design.ratio_error_share)
    t["delay_error"] = design.delay_error_s
    t["engine_lag"] = design.engine_torque_lag_s
    t["engine_delay"] = design.engine_torque_delay_s / vehicle.engine_inertia_kgm2
    t["parameter_error"] = design.parameter_error_share
    t["lasting"] = deviations(design)
    t["acceleration_error"] = design.acceleration_error_m_s2
    t["grade_error"] = design.grade_error_rad
    t["command_share"] = np.nan if design.command_error_share is None else design.command_error_share
    t["command_error"] = design.command_error_nm
    t["command_lag"] = design.command_lag_s
    t["command_time"] = design.command_error_time_s
    t["inertial_time"] = design.inertial_error_time_s
    chassis = vehicle.chassis
    r = chassis.wheel_radius_m
    t["grip"] = 0.5 * design.tyre_friction * chassis.mass_kg * STANDARD_GRAVITY * r
    t["fastest_grip"] = design.tyre_friction * STANDARD_GRAVITY / r
    t["tyre_damping"] = tyre_damping(vehicle, design)
    t["mass_arm"] = r * chassis.mass_kg
    t["rolling_torque"] = chassis.rolling_resistance * r * chassis.mass_kg * STANDARD_GRAVITY
    t["air_torque"] = 0.5 * AIR_DENSITY * chassis.drag_coefficient * chassis.frontal_area_m2 * r**3
    t["J_b_wheels"] = 0.5 * chassis.wheel_inertia_kgm2
    t["J_b"] = chassis.mass_kg * r**2 + t["J_b_wheels"]
    t["J_e"] = vehicle.engine_inertia_kgm2
    t["fastest_engine"] = (
        sum(clutch.static_capacity_nm for clutch in vehicle.clutches) / vehicle.engine_inertia_kgm2
    )
    for i in range(2):
        t["synchroniser_ratio"][0, i] = np.mean([abs(gear.total_ratio) for gear in vehicle.gears_on(i + 1)])
    t["synchroniser_torque"] = design.synchroniser_torque_nm / math.sqrt(12.0)  # anything from none to all
    t["output_twist"] = 1.0 / vehicle.output_shaft.stiffness_nm_per_rad
    for i, shaft in enumerate(vehicle.shafts):
        for gear in vehicle.gears_on(i + 1):
            place = 0, i, gear.number + 1
            in_driving, out_driving = arms(vehicle, gear, True)
            in_driven, out_driven = arms(vehicle, gear, False)
            t["ratio"][place] = gear.total_ratio
            t["loss_span"][place] = out_driven / in_driven - out_driving / in_driving
            t["transfer_twist"][place] = 1.0 / (out_driving * shaft.transfer_stiffness_nm_per_rad)
    t["neutral"] = [design.synchroniser_rad_s2 * vehicle.shaft_inertia_kgm2(i) for i in (1, 2)]
    t["neutral_rate"] = t["neutral"] / design.torque_rate_time_s
    return t
