"""Driving conditions at which the observer's gains are judged: what a vehicle can do in a pair of gears.

The errors of the observer depend on the engine speed and on the wheel acceleration alone. Both have to belong to
the same drive, so each condition follows from a torque balance of the vehicle in one of the two gears.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dctorque_can.driveline.parameters import AIR_DENSITY, STANDARD_GRAVITY, Gear, Vehicle

LAUNCH_ENGINE_SPEED = 150.0  # rad/s, 1430 rpm
LAUNCH_VEHICLE_SPEED = 1.0  # m/s
ACCELERATING_ENGINE_SPEED = 300.0  # rad/s, 2860 rpm
CRUISE_ENGINE_SPEED = 200.0  # rad/s, 1910 rpm
ENGINE_LOAD = (
    0.5  # full engine torque as a share of the weaker clutch's static capacity; no file has an engine map
)
MOTORED_LOAD = -0.1  # engine torque with the fuel cut, as a share of full engine torque
MAX_ACCELERATION = 0.5 * STANDARD_GRAVITY  # m/s², what a driven axle puts on the road
BRAKING = -3.0  # m/s²


@dataclass(frozen=True, slots=True)
class DrivingCondition:
    """One point of a drive.

    Attributes:
        name: launch, accelerating, cruise or braking.
        gear: the gear whose clutch carries the torque.
        engine_speed_rad_s: ω_e.
        wheel_speed_rad_s: ω_w, signed as the ratio.
        wheel_acceleration_rad_s2: dω_w/dt.
        clutch_torque_nm: T_c, that of ``gear``'s clutch.
        output_torque_nm: T_o at the wheels.
    """

    name: str
    gear: int
    engine_speed_rad_s: float
    wheel_speed_rad_s: float
    wheel_acceleration_rad_s2: float
    clutch_torque_nm: float
    output_torque_nm: float


def neighbouring_pairs(vehicle: Vehicle) -> tuple[tuple[int, int], ...]:
    """Return the pairs (gear on shaft 1, gear on shaft 2) of forward gears next to each other, lowest first."""
    pairs = [pair for pair in all_pairs(vehicle) if min(pair) > 0 and abs(pair[0] - pair[1]) == 1]
    return tuple(sorted(pairs, key=min))


def all_pairs(vehicle: Vehicle) -> tuple[tuple[int, int], ...]:
    """Return every pair (gear on shaft 1, gear on shaft 2), reverse included."""
    return tuple((one.number, two.number) for one in vehicle.gears_on(1) for two in vehicle.gears_on(2))


def driving_conditions(vehicle: Vehicle, g1: int, g2: int) -> tuple[DrivingCondition, ...]:
    """Return what a vehicle does with gear ``g1`` on shaft 1 and ``g2`` on shaft 2 engaged.

    * launch, only with the lowest gear of its direction: the clutch slips, the engine holds its speed;
    * accelerating with full engine torque in the shorter gear;
    * cruise in the longer gear, dω_w/dt = 0;
    * braking in the longer gear, the fuel cut.
    """
    short, long = sorted((vehicle.gear(g1), vehicle.gear(g2)), key=lambda gear: -abs(gear.total_ratio))
    same_direction = [gear for gear in vehicle.gears if gear.total_ratio * short.total_ratio > 0]
    conditions = []
    if short.number == max(same_direction, key=lambda gear: abs(gear.total_ratio)).number:
        conditions.append(_launch(vehicle, short))
    conditions.append(_accelerating(vehicle, short))
    conditions.append(_cruise(vehicle, long))
    conditions.append(_braking(vehicle, long))
    return tuple(conditions)


def full_engine_torque(vehicle: Vehicle) -> float:
    """Return the full engine torque that the clutches were made for, N·m."""
    return ENGINE_LOAD * min(clutch.static_capacity_nm for clutch in vehicle.clutches)


def _road_load(vehicle: Vehicle, w_w: float) -> float:
    """Return (11) without grade, N·m at the wheel, signed as the speed."""
    chassis, v = vehicle.chassis, w_w * vehicle.chassis.wheel_radius_m
    roll = chassis.rolling_resistance * chassis.mass_kg * STANDARD_GRAVITY
    drag = 0.5 * AIR_DENSITY * chassis.drag_coefficient * chassis.frontal_area_m2 * v**2
    return math.copysign(chassis.wheel_radius_m * (roll + drag), w_w)


def _efficiency(vehicle: Vehicle) -> float:
    return vehicle.gear_efficiency * vehicle.final_drive_efficiency


def _drive(
    vehicle: Vehicle, name: str, gear: Gear, w_e: float, w_w: float, engine_inertia: float
) -> DrivingCondition:
    """Full engine torque in ``gear``; ``engine_inertia`` is what it accelerates before the clutch."""
    R, efficiency, J_v = gear.total_ratio, _efficiency(vehicle), vehicle.chassis.inertia_kgm2
    T_v = _road_load(vehicle, w_w)
    a_w = (efficiency * R * full_engine_torque(vehicle) - T_v) / (J_v + efficiency * R**2 * engine_inertia)
    grip = MAX_ACCELERATION / vehicle.chassis.wheel_radius_m
    a_w = min(max(a_w, -grip), grip)
    T_o = T_v + J_v * a_w
    return DrivingCondition(name, gear.number, w_e, w_w, a_w, T_o / (efficiency * R), T_o)


def _launch(vehicle: Vehicle, gear: Gear) -> DrivingCondition:
    w_w = math.copysign(LAUNCH_VEHICLE_SPEED / vehicle.chassis.wheel_radius_m, gear.total_ratio)
    return _drive(vehicle, "launch", gear, LAUNCH_ENGINE_SPEED, w_w, 0.0)


def _accelerating(vehicle: Vehicle, gear: Gear) -> DrivingCondition:
    w_e = ACCELERATING_ENGINE_SPEED
    J_e = vehicle.engine_inertia_kgm2 + vehicle.damper.inertia_kgm2
    return _drive(vehicle, "accelerating", gear, w_e, w_e / gear.total_ratio, J_e)


def _cruise(vehicle: Vehicle, gear: Gear) -> DrivingCondition:
    w_w = CRUISE_ENGINE_SPEED / gear.total_ratio
    T_o = _road_load(vehicle, w_w)
    T_c = T_o / (_efficiency(vehicle) * gear.total_ratio)
    return DrivingCondition("cruise", gear.number, CRUISE_ENGINE_SPEED, w_w, 0.0, T_c, T_o)


def _braking(vehicle: Vehicle, gear: Gear) -> DrivingCondition:
    """The brakes give the acceleration; the driveline gives what the motored engine takes."""
    R, J_e = gear.total_ratio, vehicle.engine_inertia_kgm2 + vehicle.damper.inertia_kgm2
    a_w = math.copysign(BRAKING / vehicle.chassis.wheel_radius_m, -R)
    T_c = MOTORED_LOAD * full_engine_torque(vehicle) - J_e * R * a_w
    efficiency = _efficiency(vehicle) ** (1.0 if T_c > 0 else -1.0)
    return DrivingCondition(
        "braking", gear.number, CRUISE_ENGINE_SPEED, CRUISE_ENGINE_SPEED / R, a_w, T_c, efficiency * R * T_c
    )
