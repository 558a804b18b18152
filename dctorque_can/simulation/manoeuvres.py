"""Manoeuvres: short drives of what the paper's drive and the traffic of a mixed drive do not have."""

from __future__ import annotations

from collections.abc import Callable
from math import pi, sin
from typing import Final

from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.simulation.control import AUTOMATIC, NEUTRAL, REVERSE
from dctorque_can.simulation.drive import Drive, Knots
from dctorque_can.simulation.engine import driver_demand
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN, parameters

_OFF = -1.0  # no speed to follow: the pedals are given
_BRAKE = 6000.0  # N, firm: 3.5 m/s²


def _steps(*steps: tuple[float, float]) -> Knots:
    """Return knots of a value that is kept until the next."""
    knots: list[tuple[float, float]] = []
    for t, value in steps:
        if knots:
            knots.append((t, knots[-1][1]))
        knots.append((t, value))
    return tuple(knots)


def _reached(speed_m_s: float, by_s: float, until_s: float) -> Knots:
    """Return a speed that a driver reaches from standstill and keeps; after that the pedals are given."""
    return (0.0, 0.0), (1.0, 0.0), (by_s, speed_m_s), (until_s, speed_m_s), (until_s, _OFF)


def creep(vehicle: Vehicle) -> Drive:
    """Return a queue: twice the brake is released and the car creeps, without accelerator, until it is braked."""
    brake = ((0.0, _BRAKE), (1.0, _BRAKE), (1.3, 0.0), (7.0, 0.0), (7.5, 1500.0), (10.0, 1500.0))
    again = ((10.2, 0.0), (14.0, 0.0), (14.2, 3000.0))
    return Drive("creep", 17.0, brake_n=brake + again, creeps=True)


def roll_back(vehicle: Vehicle) -> Drive:
    """Return a start on a slope of 10 % without hill holder: the car rolls back before the clutch takes it up."""
    return Drive(
        "roll_back",
        12.0,
        pedal=((2.4, 0.0), (2.7, 0.45), (9.0, 0.45), (9.2, 0.0)),
        brake_n=((0.0, _BRAKE), (1.0, _BRAKE), (1.2, 0.0)),
        grade_rad=((0.0, 0.1),),
        hill_holder=False,
    )


def hill_hold(vehicle: Vehicle) -> Drive:
    """Return a slope of 8 % on which the slipping clutch alone holds the car for 5 s, and then a start."""
    grade = 0.08
    pedal = _holding_pedal(vehicle, grade)
    return Drive(
        "hill_hold",
        14.0,
        pedal=((1.5, 0.0), (1.9, pedal), (8.5, pedal), (8.8, 0.5), (12.0, 0.5), (12.1, 0.0)),
        brake_n=((0.0, _BRAKE), (1.0, _BRAKE), (1.2, 0.0)),
        grade_rad=((0.0, grade),),
    )


def _holding_pedal(vehicle: Vehicle, grade: float) -> float:
    """Return the pedal whose engine torque just holds the car on a slope, at the speed of a launch."""
    p = parameters(vehicle, DEMO_POWERTRAIN, 0.0)
    lever = p.ratio[1] * p.final_drive[1] * p.gear_efficiency * p.final_drive_efficiency
    torque = p.weight * sin(grade) * p.r_w / lever
    low, high = 0.0, 1.0
    while high - low > 1e-4:
        pedal = 0.5 * (low + high)
        w_e = (1200.0 + 1600.0 * pedal) * pi / 30.0
        low, high = (pedal, high) if driver_demand(p, pedal, w_e) < torque else (low, pedal)
    return low


def braked_coast_down(vehicle: Vehicle) -> Drive:
    """Return braking at 1.3 m/s² from 20 m/s to standstill, down through the gears."""
    brake = ((22.0, 0.0), (23.0, 1600.0))
    return Drive("braked_coast_down", 42.0, brake_n=brake, speed_m_s=_reached(20.0, 17.0, 22.0))


def hard_braking(vehicle: Vehicle) -> Drive:
    """Return a full braking from 22 m/s: half a second from the foot to the pedal, 8 m/s² to standstill."""
    force = 7.8 * vehicle.chassis.mass_kg
    brake = ((24.0, 0.0), (24.3, force))
    return Drive("hard_braking", 30.0, brake_n=brake, speed_m_s=_reached(22.0, 19.0, 23.9))


def kick_down(vehicle: Vehicle) -> Drive:
    """Return two kick-downs: from fourth to second over third on the way, and from fifth to second at once."""
    lever = _steps((0.0, AUTOMATIC), (15.0, 4), (18.0, 2), (24.0, 5), (30.0, 2), (34.0, AUTOMATIC))
    pedal = _steps((18.0, 1.0), (22.0, 0.0), (26.0, 0.1), (30.0, 1.0), (32.5, 0.0))
    return Drive("kick_down", 40.0, pedal=pedal, speed_m_s=_reached(12.0, 12.0, 18.0), lever=lever)


def reverse(vehicle: Vehicle) -> Drive:
    """Return a start in reverse gear, stopped by the brake; the vehicle must have one."""
    return Drive(
        "reverse",
        14.0,
        pedal=((2.0, 0.0), (2.3, 0.25), (7.5, 0.25), (7.7, 0.0)),
        brake_n=((0.0, _BRAKE), (1.6, _BRAKE), (1.8, 0.0), (8.5, 0.0), (9.0, 3000.0)),
        lever=_steps((0.0, AUTOMATIC), (0.5, REVERSE)),
    )


def sailing(vehicle: Vehicle) -> Drive:
    """Return 8 s with both clutches open and the engine idling at 18 m/s, then the gear again, under power."""
    return Drive(
        "sailing",
        34.0,
        pedal=((18.0, 0.0), (26.3, 0.0), (26.8, 0.3), (31.0, 0.3), (31.2, 0.0)),
        speed_m_s=_reached(18.0, 14.0, 17.8),
        lever=_steps((0.0, AUTOMATIC), (18.0, NEUTRAL), (26.0, AUTOMATIC)),
    )


def stop_start(vehicle: Vehicle) -> Drive:
    """Return a stop in which the engine is off for 4 s; the starter turns it, and the car sets off again."""
    return Drive(
        "stop_start",
        26.0,
        pedal=((19.0, 0.0), (19.3, 0.4), (24.0, 0.4), (24.2, 0.0)),
        brake_n=((10.0, 3000.0), (18.0, 3000.0), (18.2, 0.0)),
        speed_m_s=_reached(8.0, 7.0, 10.0),
        engine=_steps((0.0, 1.0), (14.0, 0.0), (18.0, 1.0)),
    )


def wheel_spin(vehicle: Vehicle) -> Drive:
    """Return a start with much throttle on a road of friction 0.25, which from 5 s on is dry (0.9)."""
    return Drive(
        "wheel_spin",
        10.0,
        pedal=((1.0, 0.0), (1.3, 0.7), (7.0, 0.7), (7.2, 0.0)),
        friction=_steps((0.0, 0.25), (5.0, 0.9)),
    )


MANOEUVRES: Final[dict[str, Callable[[Vehicle], Drive]]] = {
    make.__name__: make
    for make in (
        creep,
        roll_back,
        hill_hold,
        braked_coast_down,
        hard_braking,
        kick_down,
        reverse,
        sailing,
        stop_start,
        wheel_spin,
    )
}
"""By the name of the drive."""
