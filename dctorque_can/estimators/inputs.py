"""Questions that every estimator has about its inputs (`contract.INPUTS`)."""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.pipeline.samples import Quantity

ENGINE_SPEED = int(Quantity.ENGINE_SPEED)
ENGINE_TORQUE = int(Quantity.ENGINE_TORQUE)
SPEED_1 = int(Quantity.SHAFT1_SPEED)
WHEEL = int(Quantity.WHEEL_SPEED_FL)
GEAR_1 = int(Quantity.GEAR1)
COMMAND_1 = int(Quantity.CLUTCH1_COMMAND)
ACCELERATION = int(Quantity.ACCELERATION)
GEAR = int(Quantity.GEAR)
GRADE = int(Quantity.GRADE)
BRAKE = int(Quantity.BRAKE)

STANDSTILL = 0.3  # rad/s at the wheel: slower the car stands, brakes may hold anything, and every gear fits
_OPEN = int(ClutchPhase.OPEN)


@compiled_without_allocation
def usable(inputs: Any, quantity: int) -> bool:
    """Return whether an input has a value that is not too old."""
    return bool(inputs.available[quantity]) and not inputs.stale[quantity]


@compiled_without_allocation
def axle_speed(inputs: Any, left: int) -> tuple[bool, float]:
    """Return whether an axle has a speed, and the mean of its wheels that are usable."""
    a, b = usable(inputs, left), usable(inputs, left + 1)
    if a and b:
        return True, 0.5 * (inputs.value[left] + inputs.value[left + 1])
    if a:
        return True, inputs.value[left]
    return b, inputs.value[left + 1]


@compiled_without_allocation
def wheel_speeds(inputs: Any) -> tuple[bool, float, bool, float, bool]:
    """Return (known, driven mean, known, undriven mean, whether the undriven ones were just renewed).

    Without undriven wheels the driven ones stand in, and the other way round.
    """
    front_known, front = axle_speed(inputs, WHEEL)
    rear_known, rear = axle_speed(inputs, WHEEL + 2)
    front_fresh = inputs.fresh[WHEEL] or inputs.fresh[WHEEL + 1]
    rear_fresh = inputs.fresh[WHEEL + 2] or inputs.fresh[WHEEL + 3]
    if inputs.driven_axle == DrivenAxle.REAR:
        front_known, front, rear_known, rear = rear_known, rear, front_known, front
        front_fresh, rear_fresh = rear_fresh, front_fresh
    if inputs.driven_axle == DrivenAxle.ALL and front_known and rear_known:
        front = rear = 0.5 * (front + rear)
        rear_fresh = front_fresh or rear_fresh
    if not rear_known:
        return front_known, front, front_known, front, front_fresh
    if not front_known:
        return rear_known, rear, rear_known, rear, rear_fresh
    return front_known, front, rear_known, rear, rear_fresh


@compiled_without_allocation
def wheels_in_use(inputs: Any) -> int:
    """Return one bit for each wheel whose speed is usable."""
    bits = 0
    for k in range(4):
        if usable(inputs, WHEEL + k):
            bits |= 1 << k
    return bits


@compiled_without_allocation
def braking(inputs: Any) -> bool:
    """Return whether the bus says that the brake is on."""
    return usable(inputs, BRAKE) and inputs.value[BRAKE] > 0.0


@compiled_without_allocation
def may_brake(inputs: Any) -> bool:
    """Return whether the brake is on, or nothing says that it is off."""
    return not usable(inputs, BRAKE) or braking(inputs)


@compiled_without_allocation
def gears_known(inputs: Any) -> bool:
    """Return whether the gears of both shafts are known."""
    return bool(inputs.gear_known[0]) and bool(inputs.gear_known[1])


@compiled_without_allocation
def phases_known(inputs: Any) -> bool:
    """Return whether the bus says of both clutches whether they are open."""
    return bool(inputs.closed_known[0]) and bool(inputs.closed_known[1])


@compiled_without_allocation
def both_shafts_complete(inputs: Any) -> bool:
    """Return whether engine, both input shafts, gears and a wheel speed are there."""
    _, _, wheels, _, _ = wheel_speeds(inputs)
    return bool(
        wheels
        and (inputs.infer_gears or gears_known(inputs))
        and usable(inputs, ENGINE_SPEED)
        and usable(inputs, ENGINE_TORQUE)
        and usable(inputs, SPEED_1)
        and usable(inputs, SPEED_1 + 1)
    )


@compiled_without_allocation
def phase_of(inputs: Any, i: int) -> int:
    """Return the phase of a clutch; in neutral it carries nothing."""
    return int(inputs.phase[i]) if inputs.gear[i] != 0 else _OPEN
