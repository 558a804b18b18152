"""Manoeuvres: short drives of what the paper's drive and the traffic of a mixed drive do not have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi, sin
from typing import Final

from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.simulation.control import AUTOMATIC, NEUTRAL, REVERSE
from dctorque_can.simulation.drive import Drive
from dctorque_can.simulation.engine import driver_demand
from dctorque_can.simulation.faults import Faults
from dctorque_can.simulation.knots import Knots
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


def split_mu(vehicle: Vehicle) -> Drive:
    """Return a start with the left driven wheel on ice (0.1) and the right one on a dry road, until 5 s.

    The differential is open: the car gets twice the force of the wheel on ice, and the driver lifts his foot.
    """
    return Drive(
        "split_mu",
        10.0,
        pedal=((1.0, 0.0), (1.3, 0.3), (2.0, 0.3), (2.3, 0.08), (5.5, 0.08), (6.0, 0.35), (8.5, 0.35), (8.7, 0.0)),
        friction=_steps((0.0, 0.1), (5.0, 0.9)),
        friction_right=((0.0, 0.9),),
    )


def aborted_shift(vehicle: Vehicle) -> Drive:
    """Return two up-shifts from second gear that are taken back, in the torque and in the inertia phase."""
    lever = _steps((0.0, AUTOMATIC), (9.0, 2), (13.0, 3), (13.25, 2), (18.0, 3), (18.5, 2))
    pedal = ((12.0, 0.25), (22.0, 0.25), (22.2, 0.0))
    return Drive("aborted_shift", 25.0, pedal=pedal, speed_m_s=_reached(9.0, 9.0, 12.0), lever=lever)


def tie_up(vehicle: Vehicle) -> Drive:
    """Return two power-on up-shifts in which both clutches are closed too far for half a second."""
    lever = _steps((0.0, AUTOMATIC), (9.0, 2), (13.0, 3), (17.0, 4))
    pedal = ((12.0, 0.3), (20.0, 0.3), (20.2, 0.0))
    overlap = _steps((0.0, 0.0), (13.0, 110.0), (13.65, 0.0), (17.0, 70.0), (17.65, 0.0))
    return Drive(
        "tie_up",
        23.0,
        pedal=pedal,
        speed_m_s=_reached(9.0, 9.0, 12.0),
        lever=lever,
        faults=Faults(overlap_nm=overlap),
    )


def hard_synchroniser(vehicle: Vehicle) -> Drive:
    """Return third gear, in and out of power: cones of 30 N·m take shaft 2 from fourth to second and back.

    Clutch 1 is locked all the while.
    """
    pedal = _steps((13.0, 0.2), (14.5, 0.0), (16.0, 0.3), (17.5, 0.0), (19.0, 0.2), (20.5, 0.0), (22.0, 0.2))
    return Drive(
        "hard_synchroniser",
        24.0,
        pedal=pedal,
        speed_m_s=_reached(13.0, 11.0, 13.0),
        faults=Faults(synchroniser_nm=30.0),
    )


def judder(vehicle: Vehicle) -> Drive:
    """Return creeping and a gentle start uphill with capacities that swing by 8 %, at 8 Hz first and 12 last."""
    brake = ((0.0, _BRAKE), (1.0, _BRAKE), (1.3, 0.0), (6.0, 0.0), (6.5, 2000.0), (8.5, 2000.0), (8.7, 0.0))
    return Drive(
        "judder",
        16.0,
        pedal=((9.0, 0.0), (9.5, 0.3), (14.0, 0.3), (14.2, 0.0)),
        brake_n=brake,
        grade_rad=((7.0, 0.0), (8.0, 0.06)),
        creeps=True,
        faults=Faults(judder=0.08, judder_hz=(8.0, 12.0)),
    )


def friction_fading(vehicle: Vehicle) -> Drive:
    """Return three starts uphill, each after 5 s held by the clutch, which loses up to 30 % of its friction."""
    grade = 0.08
    holding = _holding_pedal(vehicle, grade)
    pedal, brake = [(0.0, 0.0)], [(0.0, _BRAKE)]
    for start in (1.0, 17.0, 33.0):
        pedal += [(start + 0.5, 0.0), (start + 0.9, holding), (start + 6.0, holding), (start + 6.3, 0.4)]
        pedal += [(start + 12.0, 0.4), (start + 12.1, 0.0)]
        brake += [(start, _BRAKE), (start + 0.2, 0.0), (start + 12.5, 0.0), (start + 13.0, _BRAKE)]
    return Drive(
        "friction_fading",
        49.0,
        pedal=tuple(pedal),
        brake_n=tuple(brake),
        grade_rad=((0.0, grade),),
        faults=Faults(fading=0.3),
    )


def touch_point_drift(vehicle: Vehicle) -> Drive:
    """Return 70 s of traffic in which clutch 1 comes to touch 0.7 mm earlier than its control knows."""
    speed = (
        (0.0, 0.0),
        (2.0, 0.0),
        (14.0, 14.0),
        (18.0, 14.0),
        (28.0, 0.0),
        (31.0, 0.0),
        (43.0, 16.0),
        (47.0, 16.0),
    )
    again = ((58.0, 0.0), (61.0, 0.0), (68.0, 9.0), (70.0, 9.0))
    moved = ((5.0, 0.0), (60.0, -0.7))
    return Drive("touch_point_drift", 70.0, speed_m_s=speed + again, faults=Faults(kissing_point_mm=moved))


def friction_drift(drive: Drive) -> Drive:
    """Return a drive on which the friction of both clutches falls steadily, by 30 % until the end."""
    worn = ((0.0, 1.0), (drive.duration_s, 0.7))
    return replace(drive, name="friction_drift", faults=replace(drive.faults, friction=worn))


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
        split_mu,
        aborted_shift,
        tie_up,
        hard_synchroniser,
        judder,
        friction_fading,
        touch_point_drift,
    )
}
"""By the name of the drive."""
