"""Which way the car goes, where the bus does not say: most production sensors count teeth, forwards and backwards.

Such a speed is a magnitude. At rest both directions are possible. Once the car moves, each is a hypothesis with a
small filter of its own, of the speed v and the road load T_v at the wheel:

    J dv/dt = R T_c − T_v          measured is ±|v|

A load is what slope, wind and brakes make of it: it is seldom a steep one, and changes slowly while nobody brakes.
The clutch torques T_c are known from the engine's side. So a car that rolls back and is caught by its clutch shows
which way it went. Speed and engine that keep together through a closed clutch show it too, since no engine turns
backwards. While both hypotheses are likely, the direction is not known (0): estimators do without what the car's
speeds say of its acceleration.

SI units: rad/s at the wheel, N·m, s.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.driveline.phase_decision import NEVER
from dctorque_can.estimators.inputs import (
    BRAKE,
    ENGINE_SPEED,
    SPEED_1,
    STANDSTILL,
    WHEEL,
    usable,
    wheel_speeds,
)
from dctorque_can.pipeline import hindsight
from dctorque_can.pipeline.direction_signal import DIRECTION_SIGNAL, forget_signal, signal_odds
from dctorque_can.pipeline.samples import Signs

_SIGNED, _UNTOLD = int(Signs.SIGNED), int(Signs.UNTOLD)

DIRECTION = np.dtype(
    [
        ("t_us", "i8"),  # of the last speed that was weighed; NEVER while the car stands
        ("moved_us", "i8"),  # since when it moves
        ("braked_us", "i8"),  # when brakes acted last, or may have
        ("together_us", "i8"),  # when engine and a closed clutch's shaft were last weighed as turning together
        ("torque", "f8"),  # N·m, of both clutches at the wheel, at ``t_us``
        ("variance", "f8"),  # (rad/s)², of a speed, as learned from the better hypothesis
        ("speed", "f8", (2,)),  # rad/s, forwards and backwards
        ("load", "f8", (2,)),  # N·m
        ("P", "f8", (2, 3)),  # variances of speed, of both together, of load
        ("odds", "f8"),  # logarithm of how much likelier forwards is, by how the speed changes
        ("steepness", "f8"),  # … by the steepest grade that it meant
        # of a direction that the bus tells (`direction_signal`):
        ("said", "i8"),  # 1 forwards, −1 backwards, 0 nothing
        ("said_us", "i8"),  # since when
        ("spoke", "i8"),  # … when it was last there
        ("changed_us", "i8"),  # … and since when
        ("counted", "i8"),  # … that counted since the car last stood
        ("stands_us", "i8"),  # since when the car stands; NEVER while it moves
        ("rested_us", "i8"),  # when it last had stood for long
        ("refuted", "u1"),  # the drive alone decided otherwise since the signal said so
        ("proven", "u1"),  # … or as a signal did that was alive
        ("measures", "u1"),  # … while the car rolled against its gear
        ("diary", hindsight.DIARY),
    ],
    align=True,
)
"""Both hypotheses."""

_NEGATIVE_WHEEL, _NEGATIVE_SHAFT = -0.5, -5.0  # rad/s, beyond what noise makes of zero
_DECIDED = 8.0  # logarithm of the odds: one in 3000
_SETTLED = 25.0
_LARGEST_STEP = 4.0  # of the logarithm, by one sample: a disturbance is no proof
_TOGETHER_PER_S = 12.0  # … by a clutch that does not slip, in a second
_SPINNING_PER_S = 150.0  # … by driven wheels that are faster than the body by a share and rad/s, under a torque
_SPIN_SHARE, _SPIN, _SPINNING_TORQUE = 0.3, 1.5, 200.0
_RINGING_SHARE = 0.25  # of the speed, by which a shaft that tells the direction may differ from the wheels
_USUAL_GRADE = 0.1  # standard deviation of the load, as a share of the weight
_LEVEL = 0.06  # … that is known well enough to be judged
_BRAKED_GRADE = 0.5  # … with brakes
_GRADE_ANGLE = 150.0  # rad of the wheel, 50 m, for which a grade lasts
_LEAST_LOAD = 40.0  # N·m/√s, by which the load changes at any speed
_RELEASED_LOAD = 300.0  # N·m/√s, by which the load may change as a hill holder lets go
_BRAKED_LOAD = 3000.0  # … and brakes
_BRAKED_US = 200_000  # for which it may after that
_TORQUE_SHARE = 0.25  # by which a torque at the wheel may be another, losses included
_TORQUE_NOISE, _TORQUE_NOISE_SHARE = 40.0, 0.03  # N·m·√s at the wheel, and √s: a tenth for a tenth of a second
_FIRST_VARIANCE = 0.1**2
_LEAST_VARIANCE = 0.03**2
_FORGETTING = 0.1  # of the variance, by each sample
_FASTEST_BACKWARDS = 30.0  # rad/s, 9 m/s, at which no car rolls backwards out of reverse gear
_LONGEST_S = 0.2  # between two samples; later ones begin anew


def first_direction(direction: NDArray[np.void]) -> None:
    """Make ``direction``, a `DIRECTION` ``[1]`` of zeros, what it is before the first frame."""
    for name in (
        "t_us",
        "moved_us",
        "braked_us",
        "together_us",
        "said_us",
        "changed_us",
        "stands_us",
        "rested_us",
    ):
        direction[name] = NEVER


@compiled_without_allocation
def forget(d: Any, inputs: Any) -> None:
    """Know nothing of the direction any more; which speeds have a sign is a matter of the car, and stays."""
    d.t_us = d.moved_us = d.braked_us = d.together_us = NEVER
    d.odds = d.steepness = 0.0
    forget_signal(d)
    hindsight.forget(d.diary)
    if inputs.magnitudes:
        inputs.direction = 0


@compiled_without_allocation
def follow(d: Any, inputs: Any, rules: Any, answer: Any) -> None:
    """Decide which way the car goes, and give every magnitude its sign.

    Args:
        d: `DIRECTION`.
        inputs: `contract.INPUTS`; its values become signed.
        rules: `rules.RULES`.
        answer: `contract.ANSWER` before this frame.
    """
    if not inputs.magnitudes:
        return
    learn_signs(inputs)
    odds = by_drive = 0.0
    told, direction = told_direction(inputs, rules)
    if not told:
        weigh(d, inputs, rules, answer)
        direction = inputs.direction
        by_drive = d.odds + d.steepness if d.t_us != NEVER else 0.0
        by_gear = -1 if in_reverse(inputs, rules) else 1
        odds = by_drive + signal_odds(d, inputs, rules, by_drive, _DECIDED, by_gear)
        if d.t_us == NEVER or d.moved_us == inputs.t_us:
            direction = 0
        if inputs.mapped[DIRECTION_SIGNAL] and odds * direction < 0.0:
            direction = 0  # what was decided with a signal's help does not stand without it
        if odds > _DECIDED:
            direction = 1
        elif odds < -_DECIDED:
            direction = -1
    hindsight.note(d.diary, inputs.t_us, direction != 0 if told else d.t_us != NEVER, direction)
    way = 0 if told else hindsight.foretold(d.diary, inputs.t_us)
    if way != 0 and d.t_us != NEVER:  # noise of a speed at rest has either sign
        direction = way
    inputs.direction = direction
    give_signs(inputs, rules, way if way != 0 else direction)
    inputs.doubt = 0.0 if direction != 0 else doubt_of(odds if abs(odds) < abs(by_drive) else by_drive, inputs)


@compiled_without_allocation
def doubt_of(odds: float, inputs: Any) -> float:
    """Return the probability that the car goes the other way than the signs of the speeds say."""
    return 1.0 / (1.0 + math.exp(odds * inputs.heading))


@compiled_without_allocation
def learn_signs(inputs: Any) -> None:
    """Take a speed as signed from its first negative value on."""
    for speed in range(SPEED_1, WHEEL + 4):
        least = _NEGATIVE_WHEEL if speed >= WHEEL else _NEGATIVE_SHAFT
        if inputs.signs[speed] == _UNTOLD and inputs.fresh[speed] and inputs.value[speed] < least:
            inputs.signs[speed] = _SIGNED


@compiled_without_allocation
def told_direction(inputs: Any, rules: Any) -> tuple[bool, int]:
    """Return whether a speed with sign tells the direction, and which: a wheel's, or that of a shaft in gear.

    The shaft rings as the car sets off, and tells it only when it turns as fast as the wheels do.
    """
    _, body = magnitude(inputs)
    for wheel in range(WHEEL, WHEEL + 4):
        if usable(inputs, wheel) and inputs.signs[wheel] == _SIGNED:
            if body < STANDSTILL:
                return True, 0
            return True, 1 if inputs.value[wheel] >= 0.0 else -1
    for i in range(2):
        ratio = rules.ratio[inputs.gear[i] + 1]
        if usable(inputs, SPEED_1 + i) and inputs.signs[SPEED_1 + i] == _SIGNED and ratio != 0.0:
            speed = inputs.value[SPEED_1 + i] / ratio
            if body < STANDSTILL or abs(abs(speed) - body) > _RINGING_SHARE * body:
                return True, 0
            return True, 1 if speed >= 0.0 else -1
    return False, 0


@compiled_without_allocation
def in_reverse(inputs: Any, rules: Any) -> bool:
    """Return whether a shaft is in reverse gear."""
    return bool(rules.ratio[inputs.gear[0] + 1] < 0.0 or rules.ratio[inputs.gear[1] + 1] < 0.0)


@compiled_without_allocation
def give_signs(inputs: Any, rules: Any, direction: int) -> None:
    """Give each magnitude the sign of the direction; unknown, that of the gears: reverse or forwards.

    A shaft in neutral turns as the engine does.
    """
    if direction == 0:
        direction = -1 if in_reverse(inputs, rules) else 1
    inputs.heading = direction
    for wheel in range(WHEEL, WHEEL + 4):
        if inputs.signs[wheel] != _SIGNED:
            inputs.value[wheel] = math.copysign(inputs.value[wheel], direction)
    for i in range(2):
        if inputs.signs[SPEED_1 + i] != _SIGNED:
            ratio = rules.ratio[inputs.gear[i] + 1]
            sign = direction * ratio if ratio != 0.0 else 1.0
            inputs.value[SPEED_1 + i] = math.copysign(inputs.value[SPEED_1 + i], sign)


@compiled_without_allocation
def weigh(d: Any, inputs: Any, rules: Any, answer: Any) -> None:
    """Hold a new wheel speed against both hypotheses, or start them as the car begins to move."""
    if not usable(inputs, BRAKE) or inputs.value[BRAKE] > 0.0:
        d.braked_us = inputs.t_us
    fresh, speed = magnitude(inputs)
    if not fresh:
        return
    known, driven, _, _, _ = wheel_speeds(inputs)
    spins = known and abs(driven) > (1.0 + _SPIN_SHARE) * speed + _SPIN
    if speed < STANDSTILL and not spins:
        d.t_us = d.moved_us = d.together_us = NEVER
        d.odds = 0.0
        return
    torque = 0.0
    for i in range(2 if answer.running else 0):
        torque += answer.T_c[i] * rules.ratio[inputs.gear[i] + 1] * rules.efficiency
    seconds = (inputs.t_us - d.t_us) * 1e-6 if d.t_us != NEVER else math.inf
    if seconds > _LONGEST_S:
        begin(d, inputs, rules, speed)
    elif abs(d.odds) < _SETTLED and seconds > 0.0:
        judge(d, inputs, rules, speed, torque, seconds)
        weigh_slip(d, inputs, rules)
        if spins and abs(torque) > _SPINNING_TORQUE:  # no other wheel would be faster than the body
            d.odds += math.copysign(_SPINNING_PER_S * seconds, torque)
    d.t_us, d.torque = inputs.t_us, torque


@compiled_without_allocation
def magnitude(inputs: Any) -> tuple[bool, float]:
    """Return whether a wheel speed is new, and how fast the car is: by the undriven wheels, if there are any."""
    undriven = WHEEL if inputs.driven_axle == DrivenAxle.REAR else WHEEL + 2
    fresh = inputs.fresh[WHEEL] or inputs.fresh[WHEEL + 1] or inputs.fresh[WHEEL + 2] or inputs.fresh[WHEEL + 3]
    for axle in (undriven, 2 * WHEEL + 2 - undriven):
        speed = -1.0
        for wheel in range(axle, axle + 2):
            if usable(inputs, wheel):
                speed = max(speed, abs(inputs.value[wheel]))  # of a dead wheel's neighbour
        if speed >= 0.0:
            return bool(fresh), speed
    return False, 0.0


@compiled_without_allocation
def load_variance(d: Any, rules: Any, t_us: int, speed: float) -> float:
    """Return by how much the load may change in a second, (N·m)²."""
    recent = t_us - _BRAKED_US
    grade: float = 2.0 * (_USUAL_GRADE * rules.weight) ** 2 * speed / _GRADE_ANGLE + _LEAST_LOAD**2
    if d.braked_us > recent:
        return max(_BRAKED_LOAD**2, grade)
    return max(_RELEASED_LOAD**2, grade) if d.moved_us > recent else grade


@compiled_without_allocation
def steepness(d: Any, rules: Any) -> float:
    """Return how much likelier forwards is, as a logarithm, by the grades that both loads would mean."""
    steep = 0.0
    for h in range(2):
        likelihood = -0.5 * d.load[h] ** 2 / ((_USUAL_GRADE * rules.weight) ** 2 + d.P[h, 2])
        steep += likelihood if h == 0 else -likelihood
    return steep


@compiled_without_allocation
def begin(d: Any, inputs: Any, rules: Any, speed: float) -> None:
    """Start both hypotheses at a measured speed."""
    d.odds, d.moved_us, d.variance = 0.0, inputs.t_us, _FIRST_VARIANCE
    d.steepness = 0.0
    if speed > _FASTEST_BACKWARDS and not in_reverse(inputs, rules):
        d.odds = _SETTLED
    braked = d.braked_us > inputs.t_us - _BRAKED_US
    grade = _BRAKED_GRADE if braked else _USUAL_GRADE
    for h in range(2):
        d.speed[h] = speed if h == 0 else -speed
        d.load[h] = 0.0
        d.P[h, 0], d.P[h, 1], d.P[h, 2] = d.variance, 0.0, (grade * rules.weight) ** 2


@compiled_without_allocation
def judge(d: Any, inputs: Any, rules: Any, speed: float, torque: float, seconds: float) -> None:
    """Predict and correct both hypotheses, and weigh them by how they predicted the speed."""
    turned = 0.5 * (torque + d.torque)
    change = _TORQUE_SHARE * (torque - d.torque)
    noise = load_variance(d, rules, inputs.t_us, speed) * seconds + change * change
    gain, keep = seconds / rules.inertia, math.exp(-seconds * speed / _GRADE_ANGLE)
    unsteady = (_TORQUE_NOISE**2 + (_TORQUE_NOISE_SHARE * turned) ** 2) / rules.inertia**2 * seconds
    least, step = math.inf, 0.0
    for h in range(2):
        d.speed[h] += gain * (turned - d.load[h])
        P_v, P_vl, P_l = d.P[h, 0], d.P[h, 1], d.P[h, 2]
        P_v += gain * (gain * P_l - 2.0 * P_vl) + unsteady
        P_vl = keep * (P_vl - gain * P_l)
        P_l = keep * keep * P_l + noise
        d.load[h] *= keep
        e = (speed if h == 0 else -speed) - d.speed[h]
        S = P_v + d.variance
        K_v, K_l = P_v / S, P_vl / S
        d.speed[h] += K_v * e
        d.load[h] += K_l * e
        d.P[h, 0], d.P[h, 1], d.P[h, 2] = P_v - K_v * P_v, P_vl - K_v * P_vl, P_l - K_l * P_vl
        least = min(least, e * e - P_v)
        likelihood = -0.5 * (e * e / S + math.log(S))
        step += likelihood if h == 0 else -likelihood
    recent = inputs.t_us - _BRAKED_US
    if d.braked_us < recent and d.P[0, 2] < (_LEVEL * rules.weight) ** 2:
        steep = steepness(d, rules)
        if abs(steep) > abs(d.steepness):
            d.steepness = steep
    d.odds += min(max(step, -_LARGEST_STEP), _LARGEST_STEP)
    d.odds = min(max(d.odds, -_SETTLED), _SETTLED)
    d.variance = max(d.variance + _FORGETTING * (least - d.variance), _LEAST_VARIANCE)


@compiled_without_allocation
def weigh_slip(d: Any, inputs: Any, rules: Any) -> None:
    """Take it for the gear's direction while the shaft of a closed clutch turns as fast as the engine."""
    sign = 0.0
    for i in range(2):
        ratio = rules.ratio[inputs.gear[i] + 1]
        slip = abs(abs(inputs.value[SPEED_1 + i]) - inputs.value[ENGINE_SPEED])
        there = usable(inputs, SPEED_1 + i) and usable(inputs, ENGINE_SPEED)
        if ratio != 0.0 and there and inputs.closed_known[i] and inputs.closed[i] and slip < rules.slip_locked:
            sign = math.copysign(1.0, ratio)
    if sign == 0.0:
        d.together_us = NEVER
        return
    if d.together_us != NEVER:
        d.odds += sign * _TOGETHER_PER_S * (inputs.t_us - d.together_us) * 1e-6
    d.together_us = inputs.t_us
