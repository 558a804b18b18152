"""What the driver and the road do, and the simulation of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.simulation.control import AUTOMATIC, NEUTRAL, REVERSE
from dctorque_can.simulation.faults import NO_FAULTS, Faults
from dctorque_can.simulation.knots import Knots, sampled
from dctorque_can.simulation.plant import new_state, run
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN, Powertrain, parameters
from dctorque_can.simulation.truth import TRUTH

PIECE = 2000
"""Milliseconds of driving at once: Python sees signals, and a progress bar moves, only between pieces."""


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive that starts at standstill in first gear.

    Attributes:
        name: one word for file names.
        duration_s: length.
        pedal: 0..1; two knots at one time make a step.
        brake_n: driver's braking force.
        grade_rad: slope of the road, positive uphill.
        speed_m_s: if not empty, a driver follows this speed and `pedal` and `brake_n` are ignored, but where it is
            negative.
        payload_kg: on top of the vehicle's mass.
        lever: steps of 0 automatic, -1 reverse (taken at standstill), -2 neutral, or a forward gear by hand.
        engine: steps of 1 on and 0 off (at standstill); on again, the starter turns it first.
        friction: of the driven tyres on the road, greatest force over load; infinite: they never spin.
        creeps: whether the clutch pulls when neither pedal is pressed.
        hill_holder: whether the gearbox control keeps the brake on until the clutch can carry the car.
        friction_right: if not empty, that of the right driven tyre, and `friction` that of the left one: they then
            turn each with its own speed, behind an open differential.
        faults: of clutches and gears.
    """

    name: str
    duration_s: float
    pedal: Knots = ((0.0, 0.0),)
    brake_n: Knots = ((0.0, 0.0),)
    grade_rad: Knots = ((0.0, 0.0),)
    speed_m_s: Knots = ()
    payload_kg: float = 0.0
    lever: Knots = ((0.0, float(AUTOMATIC)),)
    engine: Knots = ((0.0, 1.0),)
    friction: Knots = ((0.0, np.inf),)
    creeps: bool = False
    hill_holder: bool = True
    friction_right: Knots = ()
    faults: Faults = NO_FAULTS


PAPER = Drive(
    name="paper",
    duration_s=16.0,
    pedal=((1.0, 0.0), (1.0, 0.5), (7.0, 0.5), (7.0, 0.0)),
    grade_rad=((0.0, 0.1),),
)
"""Section 4.1: standing start uphill, half throttle from 1 s for 6 s, then the fuel is cut."""


def mixed_drive(vehicle: Vehicle, seed: int, duration_s: float = 360.0) -> Drive:
    """Return a drive through traffic: launches, cruising, coasting and stops, up to the top gear, on a hilly road.

    It ends as it began, at standstill on the level, so that it can be repeated.

    Args:
        vehicle: the car it is for; its number of gears decides how fast it goes.
        seed: another seed, another drive.
        duration_s: at least 180 s.

    Raises:
        DctorqueError: ``duration_s`` is too short.
    """
    if duration_s < 180.0:
        raise DctorqueError(f"a mixed drive needs at least 180 s, not {duration_s:g} s")
    random = np.random.default_rng(seed)
    top = 26.0 if max(gear.number for gear in vehicle.gears) <= 5 else 34.0
    knots: list[tuple[float, float]] = [(0.0, 0.0), (2.0, 0.0)]
    t, v = 2.0, 0.0
    goals = [top]  # every drive reaches the top gear once
    while t < duration_s - 50.0:
        goal = goals.pop() if goals else float(random.uniform(4.0, 0.6 * top))
        rate = float(random.uniform(0.7, 1.8)) if goal > v else float(random.uniform(0.5, 1.8))
        t += max(1.0, abs(goal - v) / rate * (1.0 + 0.02 * goal))
        v = goal
        knots.append((t, v))
        t += float(random.uniform(3.0, 15.0))
        knots.append((t, v))
        if random.random() < 0.4 and t < duration_s - 65.0:
            t += v / float(random.uniform(0.9, 2.0))
            v = 0.0
            knots.append((t, 0.0))
            t += float(random.uniform(2.0, 6.0))
            knots.append((t, 0.0))
    t += v / 1.3
    knots.append((min(t, duration_s - 5.0), 0.0))
    hills = np.arange(20.0, duration_s - 20.0, 15.0)
    grade = [(0.0, 0.0), *((float(s), float(random.uniform(-0.05, 0.05))) for s in hills), (duration_s - 5.0, 0.0)]
    return Drive(f"mixed{seed}", duration_s, grade_rad=tuple(grade), speed_m_s=tuple(knots))


def missing_gears(vehicle: Vehicle, drive: Drive) -> set[int]:
    """Return the gears that a drive asks for and the vehicle does not have; -1 is reverse."""
    asked = {round(position) for _, position in drive.lever}
    return asked - {AUTOMATIC, NEUTRAL} - {gear.number for gear in vehicle.gears}


def simulate(
    vehicle: Vehicle,
    drive: Drive,
    powertrain: Powertrain = DEMO_POWERTRAIN,
    progress: Callable[[float], None] = lambda fraction: None,
) -> NDArray[np.void]:
    """Simulate a drive.

    Args:
        vehicle: the car as estimators know it.
        drive: what driver and road do.
        powertrain: what estimators do not know.
        progress: is told the finished fraction, 0..1.

    Returns:
        `TRUTH` ``[n]``, one row per millisecond from 0 to ``drive.duration_s``.

    Raises:
        DctorqueError: the vehicle cannot be simulated: gears 1, 2, … must be complete and on alternate shafts, and
            the lever may ask for no gear that it lacks.
    """
    numbers = sorted(gear.number for gear in vehicle.gears if gear.number > 0)
    if numbers != list(range(1, len(numbers) + 1)) or len(numbers) < 2:
        raise DctorqueError(f"simulation needs gears 1, 2, … without a hole; the vehicle has {numbers}")
    for number in numbers[1:]:
        if vehicle.gear(number).shaft == vehicle.gear(number - 1).shaft:
            raise DctorqueError(f"simulation needs neighbouring gears on different shafts: {number - 1}, {number}")
    n = round(drive.duration_s * 1000) + 1
    t = np.arange(n) / 1000.0
    lever = np.rint(sampled(drive.lever, t)).astype(np.int64)
    if missing := missing_gears(vehicle, drive):
        names = ", ".join("reverse" if number == REVERSE else str(number) for number in sorted(missing))
        raise DctorqueError(f"drive {drive.name} needs gears that the vehicle does not have: {names}")
    p = parameters(vehicle, drive.faults.of(powertrain), drive.payload_kg)
    speed = sampled(drive.speed_m_s, t) if drive.speed_m_s else np.full(n, -1.0)
    rows = np.zeros(n, TRUTH)
    pedal, brake, grade = (sampled(k, t) for k in (drive.pedal, drive.brake_n, drive.grade_rad))
    friction, engine = sampled(drive.friction, t), sampled(drive.engine, t) > 0.5
    two_wheels = len(drive.friction_right) > 0
    faults = drive.faults.over(t, sampled(drive.friction_right or drive.friction, t))
    state = new_state(p, two_wheels)
    control = state[5]
    control["creeps"], control["holder"] = drive.creeps, drive.hill_holder
    for start in range(0, n, PIECE):
        end = min(start + PIECE, n)
        run(p, *state, pedal, brake, grade, friction, lever, engine, speed, faults, rows, start, end)
        progress(end / n)
    return rows
