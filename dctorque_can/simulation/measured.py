"""What the sensors and control units of any car say of each quantity, SI; `own_bus` says how it is sent."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dctorque_can.driveline.parameters import STANDARD_GRAVITY
from dctorque_can.driveline.phases import ClutchActuation
from dctorque_can.pipeline.samples import Quantity, Signs
from dctorque_can.simulation.messages import (
    Floats,
    Sampled,
    acceleration,
    driving_clutch_torque,
    driving_shaft_speed,
    grade,
    nominal_torque,
)
from dctorque_can.simulation.one_gear import OneGear
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN

if TYPE_CHECKING:
    from dctorque_can.simulation.sensors import Speeds

_FRONT = (Quantity.WHEEL_SPEED_FL, Quantity.WHEEL_SPEED_FR)
_REAR = (Quantity.WHEEL_SPEED_RL, Quantity.WHEEL_SPEED_RR)
_TURNS = 0.3  # rad/s at which the car counts as moving
_MOST_OF_A_FLAG = 3.0  # a brake signal that is at most this is one bit, or two with "not available"
_MOST_TRAVEL = 4.0  # a clutch closes within so many times its way to the kissing point, if the signal goes further


ONE_GEAR = {Quantity.GEAR, Quantity.TARGET_GEAR, Quantity.SHIFT_IN_PROGRESS, Quantity.CLUTCH_STATE}
"""What `Measured.gearbox` is needed for."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The sample instants of one message on one drive.

    Attributes:
        sampled: truth, instants and errors of the sensors.
        mass_kg: of the car, for what a brake is said to do.
        clutches: where the clutches begin to close, in the unit of their positions.
        gearbox: what a gearbox with one gear signal says along the truth, for `ONE_GEAR`.
    """

    sampled: Sampled
    mass_kg: float
    clutches: tuple[ClutchActuation, ClutchActuation]
    gearbox: OneGear | None = None

    def late(self, late_us: int) -> Measured:
        """Return the same instants as they were before; at the beginning of the truth nothing is older."""
        s = self.sampled
        return replace(self, sampled=replace(s, at_us=np.maximum(s.at_us - late_us, s.truth["t_us"][0])))

    def value(self, quantity: Quantity, signs: Signs, extent: tuple[float, float]) -> Floats:
        """Return what is said of a quantity, SI, ``[n]``.

        Args:
            quantity: any.
            signs: of a speed: without a sign, its magnitude.
            extent: smallest and largest value that can be sent.
        """
        s, noise = self.sampled, self.sampled.profile.noise
        match quantity:
            case Quantity.ENGINE_SPEED:
                return s.value("engine_speed_rad_s", noise.engine_speed_rad_s)
            case Quantity.ENGINE_TORQUE:
                torque = nominal_torque(s)
                return torque + noise.engine_torque_nm * s.random.standard_normal(len(torque))
            case Quantity.SHAFT1_SPEED | Quantity.SHAFT2_SPEED:
                name = f"shaft{1 + quantity - Quantity.SHAFT1_SPEED}_speed_rad_s"
                return _speed(s, s.value(name), noise.shaft_speed_rad_s, _has_sign(s, "shafts", signs, extent))
            case Quantity.DRIVING_SHAFT_SPEED:
                return driving_shaft_speed(s)
            case Quantity.TRANSMISSION_TORQUE:
                return driving_clutch_torque(s)
            case Quantity.CLUTCH1_COMMAND | Quantity.CLUTCH2_COMMAND:
                return s.value(f"clutch{1 + quantity - Quantity.CLUTCH1_COMMAND}_command_nm")
            case Quantity.CLUTCH1_POSITION | Quantity.CLUTCH2_POSITION:
                i = quantity - Quantity.CLUTCH1_POSITION
                return _position(s, i, self.clutches[i], extent)
            case Quantity.CLUTCH1_OPEN | Quantity.CLUTCH2_OPEN:
                capacity = s.value(f"clutch{1 + quantity - Quantity.CLUTCH1_OPEN}_capacity_nm")
                return (capacity <= 0.0).astype(np.float64)
            case Quantity.GEAR1 | Quantity.GEAR2:
                i = 1 + quantity - Quantity.GEAR1
                return np.where(s.state(f"changing{i}") == 1, 0, s.state(f"gear{i}")).astype(np.float64)
            case Quantity.GEAR | Quantity.TARGET_GEAR | Quantity.SHIFT_IN_PROGRESS | Quantity.CLUTCH_STATE:
                return self._told(quantity)
            case Quantity.ACCELERATION:
                return acceleration(s, float(s.lasting.standard_normal()))
            case Quantity.GRADE:
                return grade(s, float(s.lasting.standard_normal()))
            case Quantity.BRAKE:
                return self._brake(extent[1])
            case Quantity.DIRECTION:
                speed = s.value("undriven_wheel_speed_rad_s", late_us=s.profile.direction.delay_us)
                return np.where(np.abs(speed) > _TURNS, np.sign(speed), 0.0)
            case _:
                has_sign = _has_sign(s, "wheels", signs, extent)
                return _speed(s, self._wheel(quantity), noise.wheel_speed_rad_s, has_sign)

    def _told(self, quantity: Quantity) -> Floats:
        s, told = self.sampled, self.gearbox
        assert told is not None
        columns = {
            Quantity.GEAR: told.actual,
            Quantity.TARGET_GEAR: told.target,
            Quantity.SHIFT_IN_PROGRESS: told.shifting,
            Quantity.CLUTCH_STATE: told.state,
        }
        rows = np.searchsorted(s.truth["t_us"], s.at_us, side="right") - 1
        return columns[quantity][rows].astype(np.float64)

    def _brake(self, most: float) -> Floats:
        """Return 1 while the brake is on, if there is no room for more; else its force as a share of the most."""
        force = self.sampled.value("brake_n")
        if most <= _MOST_OF_A_FLAG:
            return (force > 0.0).astype(np.float64)
        return most * np.minimum(force / (self.mass_kg * STANDARD_GRAVITY), 1.0)

    def _wheel(self, quantity: Quantity) -> Floats:
        s = self.sampled
        axle = "front" if quantity in _FRONT else "rear"
        if s.profile.driven_axle not in ("all", axle):
            return s.value("undriven_wheel_speed_rad_s")
        left = quantity in (_FRONT[0], _REAR[0])
        return s.value("wheel_speed_rad_s") + (1.0 if left else -1.0) * s.value("wheel_difference_rad_s")


def _has_sign(s: Sampled, group: Speeds, signs: Signs, extent: tuple[float, float]) -> bool:
    return signs is not Signs.UNSIGNED and extent[0] < 0.0 and group not in s.profile.unsigned


def _speed(s: Sampled, speed: Floats, sigma: float, has_sign: bool) -> Floats:
    """Return a speed as it is measured: signed, or teeth are counted."""
    noise = sigma * s.random.standard_normal(len(speed))
    return speed + noise if has_sign else np.maximum(0.0, np.abs(speed) + noise)


def _position(s: Sampled, i: int, clutch: ClutchActuation, extent: tuple[float, float]) -> Floats:
    """Return the position of an actuator: the way of the simulated one, bent at the kissing point."""
    fully_open, closed = extent if clutch.closes_increasing else extent[::-1]
    way = clutch.threshold - fully_open
    if way != 0.0 and abs(closed - clutch.threshold) > _MOST_TRAVEL * abs(way):
        closed = clutch.threshold + _MOST_TRAVEL * way
    mm = s.value(f"clutch{i + 1}_position_mm", s.profile.noise.clutch_position_mm)
    demo = DEMO_POWERTRAIN
    ends = [0.0, demo.kissing_point_mm, demo.full_position_mm]
    return np.asarray(np.interp(mm, ends, [fully_open, clutch.threshold, closed]), np.float64)
