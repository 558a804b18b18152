"""Gears and synchronisers of the simulated car: in, out, and what is lost in them, with the load and without.

A synchroniser is a cone clutch between an input shaft and the output shaft (times the gear's total ratio); the
gear is engaged only once the cone sticks, so momentum is conserved and nothing is ever set to a speed. The
transfer shaft's spring starts untwisted then.
"""

from __future__ import annotations

from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.simulation.layout import BODY, CLUTCH1, CONE1, OUTPUT, PERIOD, SHAFT1, TWIST_TRANSFER1
from dctorque_can.simulation.mechanism import FREE, STUCK, Mechanism, Motion, spring_torque
from dctorque_can.simulation.powertrain import Parameters

_PATIENCE = 2.0  # times of a synchroniser after which it is pressed with its greatest force
_BACKWARDS = 0.01  # m/s
_TURNING = 1.0  # rad/s, from which dry friction of bearings and seals has all its torque
_LOSSES_TURN = 0.1  # rad/s of the output shaft, on either side of zero: within, the losses fade and turn round


@compiled_without_allocation
def engage(p: Parameters, mechanism: Mechanism, motion: Motion, a: Any, shaft: int, gear: int) -> None:
    """Join a shaft to the output shaft through the transfer shaft of ``gear``, or let it go (gear 0)."""
    spring = TWIST_TRANSFER1 + shaft
    a.lost_j += 0.5 * mechanism.stiffness[spring] * motion.twist[spring] ** 2
    motion.twist[spring] = 0.0
    a.engaged[shaft] = gear
    rate_in = 1.0 / p.ratio[gear] if gear != 0 else 0.0
    mechanism.stiffness[spring] = p.k_t[shaft] if gear != 0 else 0.0
    mechanism.damping[spring] = p.b_t[shaft] if gear != 0 else 0.0
    mechanism.spring_speed[spring, SHAFT1 + shaft] = rate_in
    mechanism.spring_speed[spring, OUTPUT] = -p.final_drive[gear]


@compiled_without_allocation
def change_gears(p: Parameters, mechanism: Mechanism, motion: Motion, a: Any, command: Any) -> None:
    """Move the sleeves: out of a gear, to the cone of the next, and in when the cone sticks.

    A gear is left only while its clutch has no capacity.
    """
    for shaft in range(2):
        cone = CONE1 + shaft
        if not a.changing[shaft]:
            if command[shaft] != a.engaged[shaft] and motion.mode[CLUTCH1 + shaft] == FREE:
                engage(p, mechanism, motion, a, shaft, 0)
                a.changing[shaft] = True
                a.target[shaft] = command[shaft]
                a.sleeve[shaft] = 0.0
            continue
        if a.target[shaft] != command[shaft]:
            a.target[shaft] = command[shaft]
            a.sleeve[shaft] = 0.0
            a.cone[shaft] = 0.0
        gear = a.target[shaft]
        a.sleeve[shaft] += PERIOD
        if a.sleeve[shaft] < p.sleeve_time:
            continue
        if gear == 0:
            a.changing[shaft] = False
            continue
        total = p.ratio[gear] * p.final_drive[gear]
        mechanism.contact[cone, SHAFT1 + shaft] = 1.0
        mechanism.contact[cone, OUTPUT] = -total
        if a.cone[shaft] == 0.0:
            distance = abs(motion.speed[SHAFT1 + shaft] - total * motion.speed[OUTPUT])
            wish = mechanism.mass[SHAFT1 + shaft] * distance / p.cone_time
            a.cone[shaft] = min(p.cone_max, max(1.0, wish))
        elif a.sleeve[shaft] > p.sleeve_time + _PATIENCE * p.cone_time and motion.mode[cone] != STUCK:
            a.cone[shaft] = p.cone_max  # the drag of the open clutch holds it off: with all it has
        elif motion.mode[cone] == STUCK:
            engage(p, mechanism, motion, a, shaft, gear)
            a.cone[shaft] = 0.0
            a.changing[shaft] = False


@compiled_without_allocation
def spin_loss(p: Parameters, shaft: int, speed: float) -> float:
    """Return the torque against a shaft that turns and carries nothing, N·m; shaft 2 is the output shaft."""
    turning = min(1.0, max(-1.0, speed / _TURNING))
    return float(p.spin_loss[shaft, 0] * turning + p.spin_loss[shaft, 1] * speed)


@compiled_without_allocation
def _arms(p: Parameters, gear: int, driving: bool) -> tuple[float, float]:
    """Return the lever arms of input shaft and output shaft at the transfer shaft, losses included."""
    arm_in, arm_out = 1.0 / p.ratio[gear], p.final_drive[gear]
    if driving:
        return arm_in / p.gear_efficiency, arm_out * p.final_drive_efficiency
    return arm_in * p.gear_efficiency, arm_out / p.final_drive_efficiency


@compiled_without_allocation
def set_losses(p: Parameters, mechanism: Mechanism, motion: Motion, a: Any) -> None:
    """Set the lossy lever arms of both gears by the direction of their power (losses always against the flow).

    Until the car goes backwards for the first time the direction of the torque is enough.
    """
    if motion.speed[BODY] < -_BACKWARDS:
        a.went_back = True
    for shaft in range(2):
        gear = a.engaged[shaft]
        if gear == 0:
            mechanism.spring_torque[TWIST_TRANSFER1 + shaft, SHAFT1 + shaft] = 0.0
            mechanism.spring_torque[TWIST_TRANSFER1 + shaft, OUTPUT] = 0.0
            continue
        spring = TWIST_TRANSFER1 + shaft
        driving = spring_torque(mechanism, motion, spring) * p.ratio[gear] >= 0.0
        arm_in, arm_out = _arms(p, gear, driving)
        if a.went_back:
            forward = motion.speed[OUTPUT] if p.ratio[gear] > 0.0 else -motion.speed[OUTPUT]
            share = 0.5 - 0.5 * min(1.0, max(-1.0, forward / _LOSSES_TURN))
            other_in, other_out = _arms(p, gear, not driving)
            arm_in += share * (other_in - arm_in)
            arm_out += share * (other_out - arm_out)
        mechanism.spring_torque[spring, SHAFT1 + shaft] = arm_in
        mechanism.spring_torque[spring, OUTPUT] = -arm_out
