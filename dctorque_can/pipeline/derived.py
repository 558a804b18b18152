"""What follows from the clutch torques: friction power and energy, temperature, command residual, tie-up.

`follow` is called after every frame, `report` for every estimate. Power and energy are those of friction while a
clutch slips; an open or locked clutch, and one whose gear is neutral, has none.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators.inputs import COMMAND_1, phase_of, usable
from dctorque_can.pipeline.bivariate_normal import upper_quadrant
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.pipeline.thresholds import MOST_POWER_W, TIE_UP_NM

TRANSMISSION_TORQUE = int(Quantity.TRANSMISSION_TORQUE)
_OPEN, _SLIPPING = int(ClutchPhase.OPEN), int(ClutchPhase.SLIPPING)
_CLUTCH_VALID = int(Status.CLUTCH1_VALID)  # bits of clutch 1; those of clutch 2 are the next higher ones
_ENERGY_KNOWN = int(Status.ENERGY1_KNOWN)
_RESIDUAL_KNOWN = int(Status.RESIDUAL1_KNOWN)
_TEMPERATURE_KNOWN = int(Status.TEMPERATURE1_KNOWN)
_TIE_UP_KNOWN = int(Status.TIE_UP_KNOWN)
_TRANSMISSION_TORQUE_KNOWN = int(Status.TRANSMISSION_TORQUE_KNOWN)

DERIVED = np.dtype(
    [
        ("t_us", "i8"),  # of the last frame
        ("slip", "f8", (2,)),  # of each clutch, rad/s; positive when the engine is faster
        ("power", "f8", (2,)),  # W
        ("heat", "f8", (2,)),  # J since the start
        ("energy", "f8", (2,)),  # J of the present or the last engagement
        ("engagements", "i8", (2,)),
        ("was_open", "u1", (2,)),  # known to be so in the last frame
        ("engaging", "u1", (2,)),
        ("whole", "u1", (2,)),  # nothing of the engagement has been missed
        ("temperature", "f8", (2,)),  # °C
    ],
    align=True,
)
"""State of both clutches beside the estimator's."""


def new(coolant_c: NDArray[np.float64]) -> NDArray[np.void]:
    """Return the `DERIVED` record ``[1]`` of clutches that are as warm as the coolant ``[2]``."""
    d = np.zeros(1, DERIVED)
    d["t_us"] = NEVER
    d["temperature"] = coolant_c
    return d


@compiled_without_allocation
def bounded(value: float, limit: float) -> float:
    """Return ``value`` within ±limit."""
    return min(max(value, -limit), limit)


@compiled_without_allocation
def follow(core: Any, inputs: Any, rules: Any, answer: Any, d: Any) -> None:
    """Carry powers, energies and temperatures to the frame that has just taken effect."""
    runs = bool(answer.running)
    goes_on = runs and answer.reset_us != inputs.t_us
    dt = max(inputs.t_us - d.t_us, 0) * 1e-6 if d.t_us != NEVER else 0.0
    d.t_us = inputs.t_us
    for i in range(2):
        phase = phase_of(inputs, i)
        d.slip[i] = answer.slip[i]
        power = 0.0
        if runs and phase == _SLIPPING:
            power = min(abs(bounded(answer.T_c[i], inputs.torque_limit[i]) * d.slip[i]), MOST_POWER_W)
        work = 0.5 * (d.power[i] + power) * dt if goes_on else 0.0
        d.power[i] = power
        d.heat[i] += work
        count_engagement(core, d, i, phase, goes_on and bool(inputs.closed_known[i]), work)
        if rules.heats[i] and dt > 0.0:
            warm(rules, d, i, work / dt, dt)


@compiled_without_allocation
def count_engagement(core: Any, d: Any, i: int, phase: int, known: bool, work: float) -> None:
    """Add the work of an interval to the energy of an engagement: from leaving open until locked or open again."""
    if known and d.was_open[i] and phase != _OPEN:
        d.engagements[i] += 1
        d.energy[i] = 0.0
        d.engaging[i] = d.whole[i] = True
    d.was_open[i] = known and phase == _OPEN
    if not known:
        d.engaging[i] = d.whole[i] = False
    elif d.engaging[i]:
        d.energy[i] += work
        if not core.status & (_CLUTCH_VALID << i):  # of the last estimate
            d.whole[i] = False
        d.engaging[i] = phase == _SLIPPING


@compiled_without_allocation
def warm(rules: Any, d: Any, i: int, power: float, dt: float) -> None:
    """Solve C dθ/dt = P − h (θ − θ_coolant) over dt at a constant power."""
    h = rules.cooling[i]
    share = -math.expm1(-h / rules.heat_capacity[i] * dt)
    final = rules.coolant[i] + power / h
    d.temperature[i] += share * (final - d.temperature[i])


@compiled_without_allocation
def report(inputs: Any, rules: Any, answer: Any, d: Any, row: Any) -> int:
    """Write what follows from the torques in ``row``; return the `Status` bits that go with it."""
    status = 0
    for i in range(2):
        if d.whole[i]:
            status |= _ENERGY_KNOWN << i
        if rules.heats[i] and answer.running:
            status |= _TEMPERATURE_KNOWN << i
        if answer.running and follows_command(inputs, rules, d, i):
            status |= _RESIDUAL_KNOWN << i
    row.clutch1_power_w, row.clutch2_power_w = d.power[0], d.power[1]
    row.clutch1_energy_j, row.clutch2_energy_j = d.energy[0], d.energy[1]
    row.clutch1_heat_j, row.clutch2_heat_j = d.heat[0], d.heat[1]
    row.clutch1_engagements, row.clutch2_engagements = d.engagements[0], d.engagements[1]
    row.clutch1_temperature_c, row.clutch2_temperature_c = d.temperature[0], d.temperature[1]
    if status & _RESIDUAL_KNOWN:
        row.clutch1_residual_nm = row.clutch1_torque_nm - commanded(inputs, d, 0)
    if status & (_RESIDUAL_KNOWN << 1):
        row.clutch2_residual_nm = row.clutch2_torque_nm - commanded(inputs, d, 1)
    status |= report_transmission(inputs, answer, row)
    sigma_1, sigma_2 = row.clutch1_sigma_nm, row.clutch2_sigma_nm
    if answer.running and sigma_1 > 0.0 and sigma_2 > 0.0:  # not of one that states none: NaN
        status |= _TIE_UP_KNOWN
    if not answer.running or phase_of(inputs, 0) == _OPEN or phase_of(inputs, 1) == _OPEN:
        return status  # what is open takes nothing back
    # a gear that turns the output the other way takes back what it drives
    sign = 1.0 if inputs.gear[0] * inputs.gear[1] > 0 else -1.0  # reverse is −1
    T_1, T_2 = row.clutch1_torque_nm, sign * row.clutch2_torque_nm
    if T_1 * T_2 < 0.0:
        row.recirculated_torque_nm = min(abs(T_1), abs(T_2))
    if status & _TIE_UP_KNOWN:
        row.tie_up_probability = tie_up_probability(T_1, T_2, sigma_1, sigma_2, sign * row.clutch_correlation)
    return status


@compiled_without_allocation
def report_transmission(inputs: Any, answer: Any, row: Any) -> int:
    """Write what the transmission itself believes; return the `Status` bit that says whose torque that must be."""
    if not usable(inputs, TRANSMISSION_TORQUE):
        return 0
    row.transmission_torque_nm = inputs.value[TRANSMISSION_TORQUE]
    one = (phase_of(inputs, 0) == _OPEN) != (phase_of(inputs, 1) == _OPEN)
    return _TRANSMISSION_TORQUE_KNOWN if answer.running and one else 0


@compiled_without_allocation
def follows_command(inputs: Any, rules: Any, d: Any, i: int) -> bool:
    """Return whether a clutch must transmit its commanded torque: it slips, more than one that counts as locked.

    Of a locked clutch the command is only the limit, and an open one transmits nothing whatever is commanded.
    """
    slips = inputs.closed_known[i] and phase_of(inputs, i) == _SLIPPING
    return bool(slips) and abs(d.slip[i]) > rules.slip_locked and usable(inputs, COMMAND_1 + i)


@compiled_without_allocation
def commanded(inputs: Any, d: Any, i: int) -> float:
    """Return what a slipping clutch should transmit, N·m: the command is a capacity, the slip gives the sign."""
    capacity = max(inputs.value[COMMAND_1 + i], 0.0)  # negative ones hold a clutch open
    return float(capacity if d.slip[i] > 0.0 else -capacity)


@compiled_without_allocation
def tie_up_probability(T_1: float, T_2: float, sigma_1: float, sigma_2: float, correlation: float) -> float:
    """Return the probability that more than `TIE_UP_NM` recirculates, in either direction.

    Args:
        T_1, T_2: torques of both clutches, N·m.
        sigma_1, sigma_2: their standard deviations, N·m, positive.
        correlation: of both errors.
    """
    first = upper_quadrant((TIE_UP_NM - T_1) / sigma_1, (TIE_UP_NM + T_2) / sigma_2, -correlation)
    second = upper_quadrant((TIE_UP_NM + T_1) / sigma_1, (TIE_UP_NM - T_2) / sigma_2, -correlation)
    return min(first + second, 1.0)
