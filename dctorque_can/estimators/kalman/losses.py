"""What is lost in the gearbox: with the load, against the flow of power, and in whatever turns.

Torques in N·m, speeds in rad/s. Temperature is left out: the vehicle file tells the losses of warm oil.
"""

from __future__ import annotations

import math
from typing import Any

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.kalman.model import CAR, T_C1, T_V, T_X, TH_O, TH_T1, W_C1, W_E, W_W
from dctorque_can.estimators.kalman.tuning import SLIDING

_OPEN, _SLIPPING, _ = (int(phase) for phase in ClutchPhase)
_CAR_STATES = len(CAR)
_REVERSAL_NM = 2.0  # beyond zero at which the losses change their direction
_REVERSAL_SIGMA = 1.0  # … and standard deviations of the torque
_AGAINST = 5.0  # rad/s, from which a shaft turns against the engine
_TURNING = 1.0  # rad/s, from which bearings and seals have all their friction


@compiled_without_allocation
def spin_loss(constant: float, growth: float, speed: float) -> float:
    """Return the torque against a shaft that turns and carries nothing."""
    return constant * min(1.0, max(-1.0, speed / _TURNING)) + growth * speed


@compiled_without_allocation
def take_spin_losses(f: Any, tuning: Any, step: Any) -> None:
    """Let the spin losses of the three shafts act on the state to come, ``f.next``, in one `model.STEP`."""
    for k in range(3):
        speed = f.x[W_C1 + k] if k < 2 else f.x[W_W]  # the output shaft itself is light and rings
        loss = spin_loss(tuning.spin_loss[k, 0], tuning.spin_loss[k, 1], speed)
        for n in range(_CAR_STATES):
            f.next[CAR[n]] += step.losses[k, n] * loss


@compiled_without_allocation
def admit_spin_losses(f: Any, tuning: Any) -> None:
    """Let the output torque be as uncertain as the spin losses of the shafts that are in gear.

    They last and no speed tells of them, so that no measurement makes them surer. One oil cools both shafts: their
    errors add up.
    """
    at_wheel = 0.0
    for i in range(2):
        speed = abs(f.x[W_C1 + i])
        dry, churning = spin_loss(tuning.spin_loss_error[0], 0.0, speed), tuning.spin_loss_error[1] * speed
        at_wheel += abs(tuning.ratio[i, f.gear[i] + 1]) * math.hypot(dry, churning)  # zero in neutral
    f.sigma_o = math.hypot(f.sigma_o, at_wheel)


@compiled_without_allocation
def decide_directions(f: Any, tuning: Any, phase_1: int, phase_2: int) -> None:
    """Decide where losses go.

    Friction follows the slip. Else the sign of the torque decides, with a band: a choice that followed the noise
    would make two models of one torque contradict each other. A car that rolls against its gear drives a clutch
    that pulls the other way.
    """
    for i in range(2):
        phase, torque = phase_1 if i == 0 else phase_2, f.x[T_C1 + i]
        pulled = bool(f.drives[i]) != bool(f.against[i])
        if abs(f.x[W_C1 + i]) > _AGAINST:
            f.against[i] = f.x[W_C1 + i] < 0.0
        if phase == _OPEN:
            f.drives[i] = (torque >= 0.0) != bool(f.against[i])
            continue
        slip = f.x[W_E] - f.x[W_C1 + i]
        band = _REVERSAL_NM + _REVERSAL_SIGMA * math.sqrt(max(f.P[T_C1 + i, T_C1 + i], 0.0))
        pulls = torque > -band if pulled else torque > band
        if phase == _SLIPPING and abs(slip) > SLIDING:
            pulls = slip > 0.0
        drives = pulls != bool(f.against[i])
        if drives != bool(f.drives[i]):
            f.drives[i] = drives
            turn_losses(f, tuning, i)


@compiled_without_allocation
def turn_losses(f: Any, tuning: Any, i: int) -> None:
    """Spread the torques behind gear pair i, whose losses have changed sides.

    What was known of clutch and output torque together stood on the old losses. Two lines T_o = R η^±1 T_c meet in
    zero alone, and there the filter would be sure to be. By the span between the lines output twist, tyre torque
    and road load become uncertain together, since their differences are known from the wheels.
    """
    gear = f.gear[i] + 1
    span = tuning.loss_span[i, gear]
    variance = span * span * (f.P[T_C1 + i, T_C1 + i] + f.x[T_C1 + i] ** 2)
    places = (TH_T1 + i, TH_O, T_X, T_V)
    shares = (tuning.transfer_twist[i, gear], tuning.output_twist, 1.0, 1.0)
    for k in range(4):
        for m in range(4):
            f.P[places[k], places[m]] += variance * shares[k] * shares[m]


@compiled_without_allocation
def admit_either_direction(f: Any, tuning: Any, doubt: float) -> None:
    """Let the output torque be as uncertain as losses make it that perhaps go the other way.

    Args:
        f: filter.
        tuning: of it.
        doubt: probability that they do.
    """
    share = math.sqrt(doubt * (1.0 - doubt))
    for i in range(2):
        span = share * tuning.loss_span[i, f.gear[i] + 1] * f.x[T_C1 + i]  # zero in neutral
        f.sigma_o = math.hypot(f.sigma_o, span)
