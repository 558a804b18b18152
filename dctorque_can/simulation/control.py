"""Gearbox control: launch, creep, preselection, power-on and power-off shifts, coasting to a stop, sailing.

It decides once a millisecond and sees the true speeds: the control is scenery here, not the subject. A shift
has a torque phase (the clutches overlap, the load changes hands) and an inertia phase (the engine follows a
planned speed to the other shaft). Where the on-coming clutch can pull the engine to its own speed (power-on up,
power-off down) the torque phase comes first; in the two other kinds the engine moves by itself and the torque
phase comes last.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.simulation.engine import CRANKED, closed, driver_demand, full_load, starter, with_idle_control
from dctorque_can.simulation.gear_choice import up_shift_speed, wanted_gear
from dctorque_can.simulation.mechanism import STUCK
from dctorque_can.simulation.powertrain import Parameters


class ControlState(IntEnum):
    """What the gearbox control is doing."""

    OPEN = 0  # no clutch closed: standing, creeping, sailing, or rolling to a stop
    LAUNCH = 1
    DRIVE = 2
    FILL = 3  # a shift is decided: its gear goes in, its clutch to the kissing point
    TORQUE = 4
    INERTIA = 5


OPEN, LAUNCH, DRIVE, FILL, TORQUE, INERTIA = (int(state) for state in ControlState)

AUTOMATIC, REVERSE, NEUTRAL = 0, -1, -2
"""Positions of the lever; a number from 1 on is a forward gear chosen by hand."""

CONTROL = np.dtype(
    [
        ("state", "i8"),
        ("since", "f8"),  # s in this state
        ("shifted", "f8"),  # s since the last shift
        ("gear", "i8"),  # in use
        ("target", "i8"),  # of the shift
        ("sign", "f8"),  # of the torque that the shift hands over
        ("torque_first", "bool"),
        ("handed_over", "bool"),  # the torque phase is done
        ("duration", "f8"),  # of the inertia phase, s
        ("w_ref", "f8"),  # engine speed reference, rad/s
        ("dw_e", "f8"),  # engine acceleration, rad/s²
        ("last_w_e", "f8"),
        ("dw_w", "f8"),  # wheel acceleration, filtered
        ("last_w_w", "f8"),
        ("last_wish", "f8"),  # engine torque wished for in the last millisecond, N·m
        ("wish_rate", "f8"),  # N·m/s, filtered
        ("preselect", "i8"),  # gear wanted on the idle shaft
        ("preselect_wait", "f8"),
        ("lever", "i8"),
        ("creeps", "bool"),  # the clutch pulls at rest when neither pedal is pressed
        ("holder", "bool"),  # there is a hill holder
        ("engine_on", "bool"),  # off: no fuel, and the engine turns until its drag has stopped it
        # Outputs
        ("engine_command", "f8"),
        ("capacity", "f8", (2,)),  # N·m
        ("ready", "u1", (2,)),  # clutch waits near the kissing point
        ("gear_command", "i8", (2,)),
        ("hold_n", "f8"),  # braking force of the hill holder
    ],
    align=True,
)

STEP = 1e-3
_FILL_TIME = 0.12
_OVERLAP_TIME = 0.2
_TRACKING = 4.0  # N·m per rad/s of engine speed error
_OPEN_SPEED = 1000 * np.pi / 30  # coasting below this input speed opens the clutch
_PRESELECT_DELAY = 0.3
_SHIFT_PAUSE = 0.6
_HOLD_SPEED = 0.3  # m/s
_CREEP_TORQUE = 30.0  # N·m
_CREEP_SHARES = (0.6, 0.9)  # of idle speed: input speeds between which the creep torque goes away
_HOLD = 0.4  # braking force of the hill holder per weight


@compiled_without_allocation
def _enter(c: Any, state: int) -> None:
    c.state = state
    c.since = 0.0


@compiled_without_allocation
def _approach(value: float, target: float, step: float) -> float:
    return min(value + step, max(value - step, target))


@compiled_without_allocation
def _creep(p: Parameters, c: Any, brake: float, w_c: float, engaged: Any) -> float:
    """Return the clutch torque of creeping, N·m, 0 if the car is not to creep."""
    shaft = p.gear_shaft[c.gear]
    if not c.creeps or brake > 0.0 or c.lever == NEUTRAL or engaged[shaft] != c.gear:
        return 0.0
    low, high = _CREEP_SHARES
    return _CREEP_TORQUE * min(1.0, max(0.0, (high - w_c / p.idle) / (high - low)))


@compiled_without_allocation
def _open(p: Parameters, c: Any, pedal: float, brake: float, v: float, creep: float, engaged: Any) -> None:
    for i in range(2):  # gently at the end: the driveline is wound up
        fast = c.capacity[i] > 40.0 or brake > 0.0
        aim = creep if i == p.gear_shaft[c.gear] else 0.0
        c.capacity[i] = _approach(c.capacity[i], aim, (600.0 if fast else 100.0) * STEP)
    if abs(v) < _HOLD_SPEED and (c.lever == REVERSE) != (c.gear < 0):
        c.gear = -1 if c.lever == REVERSE else 1
        c.gear_command[1 - p.gear_shaft[c.gear]] = 0
    while c.gear > 1 and v < up_shift_speed(p, c.gear - 1, 0.0) - p.shift_hysteresis:
        c.gear -= 1
    shaft = p.gear_shaft[c.gear]
    c.gear_command[shaft] = c.gear
    c.ready[shaft] = pedal > 0.0 or creep > 0.0
    c.ready[1 - shaft] = False
    if pedal > 0.0 and brake == 0.0 and c.lever != NEUTRAL and engaged[shaft] == c.gear:
        c.w_ref = c.last_w_e
        _enter(c, LAUNCH)


@compiled_without_allocation
def _launch(p: Parameters, c: Any, pedal: float, T_e: float, w_c: float, slip: float, stuck: bool) -> None:
    """Hold the engine at a speed that suits the pedal until the shaft catches up, then meet it softly."""
    shaft = p.gear_shaft[c.gear]
    dw_c = p.ratio[c.gear] * p.final_drive[c.gear] * c.dw_w
    aim = max((1200.0 + 1600.0 * pedal) * np.pi / 30.0, w_c)
    gap = c.w_ref - w_c
    meeting = gap < 50.0 and w_c > 0.5 * aim
    if meeting:  # close the gap so that both accelerations nearly agree when it is gone
        rate = dw_c * max(0.0, 1.0 - max(0.0, gap) / 50.0) - 8.0
    else:
        rate = min(600.0, max(-300.0, 6.0 * (aim - c.w_ref)))
    c.w_ref += rate * STEP
    want = T_e - (p.J_e + p.J_d) * min(rate, 60.0) + 1.5 * (c.last_w_e - c.w_ref)
    grip = min(1.0, c.since / 0.6)
    c.capacity[shaft] = _approach(c.capacity[shaft], max(0.0, want) * grip, 600.0 * STEP)
    if stuck and c.since > 0.2:
        _enter(c, DRIVE)
    elif pedal == 0.0 and slip > 20.0 and c.since > 0.2:
        _enter(c, OPEN)


@compiled_without_allocation
def _drive(
    p: Parameters, c: Any, pedal: float, brake: float, v: float, carried: float, w_c: float, stuck: bool
) -> None:
    shaft = p.gear_shaft[c.gear]
    enough = 1.3 * abs(carried) + 40.0
    if stuck:
        c.capacity[shaft] = _approach(c.capacity[shaft], enough, 1500.0 * STEP)
    else:
        c.capacity[shaft] = _approach(c.capacity[shaft], 2.0 * enough, 200.0 * STEP)
    c.capacity[1 - shaft] = _approach(c.capacity[1 - shaft], 0.0, 3000.0 * STEP)
    if w_c < _OPEN_SPEED and (pedal == 0.0 or w_c < p.idle) and (abs(c.gear) == 1 or w_c < 0.95 * p.idle):
        _enter(c, OPEN)
        return
    wanted = wanted_gear(p, c.lever, c.gear, pedal, v)
    if wanted != c.gear and c.shifted > _SHIFT_PAUSE and stuck:
        c.target = wanted
        _enter(c, FILL)


@compiled_without_allocation
def _fill(p: Parameters, c: Any, T_e: float, pedal: float, carried: float, slips: Any, engaged: Any) -> None:
    """Wait for gear and clutch, then choose the order of the phases."""
    new = p.gear_shaft[c.target]
    c.gear_command[new] = c.target
    c.ready[new] = engaged[new] == c.target
    if engaged[new] != c.target:
        c.since = 0.0
    if c.since > _FILL_TIME:
        c.sign = 1.0 if carried > 0.0 else -1.0
        c.torque_first = (c.sign > 0.0) == (c.target > c.gear)
        c.handed_over = False
        distance = abs(slips[new])
        J = p.J_e + p.J_d
        if c.torque_first:
            # Without power the engine must lift itself: its torque cannot fall fast, so the rise is gentle.
            c.duration = min(0.55, max(0.3, distance / 340.0)) if c.sign > 0.0 else 0.55
        else:  # the planned speed starts to move at once, its greatest rate is 16/9 of the mean
            c.duration = min(0.6, max(0.3, 16 / 9 * J * distance / (0.6 * abs(T_e) + 20.0)))
        _enter(c, TORQUE if c.torque_first else INERTIA)


@compiled_without_allocation
def _hand_over(p: Parameters, c: Any, carried: float) -> None:
    """Torque phase: the on-coming clutch takes the load that the off-going one gives away."""
    old, new = p.gear_shaft[c.gear], p.gear_shaft[c.target]
    x = min(1.0, c.since / _OVERLAP_TIME)
    load = max(0.0, c.sign * carried)
    c.capacity[new] = _approach(c.capacity[new], x * load + 3.0, 3000.0 * STEP)
    rest = max(0.0, load - c.capacity[new]) * 1.08 + 10.0 * (1.0 - x)
    c.capacity[old] = _approach(c.capacity[old], rest if x < 1.0 else 0.0, 3000.0 * STEP)
    if x >= 1.0:
        c.handed_over = True
        if c.torque_first:
            _enter(c, INERTIA)
        else:
            c.gear = c.target
            c.shifted = 0.0
            _enter(c, DRIVE)


@compiled_without_allocation
def _synchronise(
    p: Parameters, c: Any, T_e: float, T_driver: float, w_old: float, w_new: float, stuck: bool
) -> float:
    """Inertia phase: lead the engine to the speed of the new shaft; return the engine torque wished for."""
    old, new = p.gear_shaft[c.gear], p.gear_shaft[c.target]
    J = p.J_e + p.J_d
    up = c.target > c.gear
    end = w_new - 0.5 * c.sign if c.torque_first else w_new + 2.0 * c.sign
    x = min(1.0, c.since / c.duration)
    part = x * x * (6.0 - 8.0 * x + 3.0 * x * x)  # quick to start, slow to meet
    rate_old = p.ratio[c.gear] * p.final_drive[c.gear] * c.dw_w
    rate_new = p.ratio[c.target] * p.final_drive[c.target] * c.dw_w
    c.w_ref = w_old + (end - w_old) * part
    dw_ref = rate_old + (rate_new - rate_old) * part + (end - w_old) * 12.0 * x * (1.0 - x) ** 2 / c.duration
    want = c.sign * (T_e - J * dw_ref + _TRACKING * (c.last_w_e - c.w_ref))
    active = new if c.torque_first else old
    late = max(0.0, c.since - c.duration)
    c.capacity[active] = _approach(c.capacity[active], max(3.0, want) + 150.0 * late, 4000.0 * STEP)
    if c.torque_first:
        c.capacity[old] = _approach(c.capacity[old], 0.0, 3000.0 * STEP)
        clutch = T_driver + (0.75 * J * abs(dw_ref) if up else 0.0)
    else:
        clutch = 0.4 * T_driver
    if c.torque_first:
        if stuck and c.since > 0.5 * c.duration:
            c.gear = c.target
            c.shifted = 0.0
            _enter(c, DRIVE)
    elif (abs(c.last_w_e - end) < 2.0 and x > 0.7) or late > 0.5:
        _enter(c, TORQUE)
    return float(clutch + J * dw_ref)


@compiled_without_allocation
def _take_back(p: Parameters, c: Any, T_e: float, w_old: float, w_new: float) -> None:
    """Go back to the gear of the lever from a shift that the on-coming clutch has begun, from where it is."""
    old, new = c.gear, c.target
    if c.state == FILL:
        c.ready[p.gear_shaft[new]] = False
        c.target = old
        _enter(c, DRIVE)
        return
    if not c.torque_first:  # the engine has gone: the shift is ended, and another one leads back
        return
    c.gear, c.target = new, old
    c.torque_first = False
    if c.state == TORQUE:
        c.since = _OVERLAP_TIME - min(c.since, _OVERLAP_TIME)
        return
    c.handed_over = False
    distance = w_old + 2.0 * c.sign - w_new
    c.duration = min(0.6, max(0.3, 16 / 9 * (p.J_e + p.J_d) * abs(distance) / (0.6 * abs(T_e) + 20.0)))
    done = (c.last_w_e - w_new) / distance if distance != 0.0 else 1.0
    low, high = 0.0, 1.0
    for _ in range(20):  # where the planned speed has the engine's
        x = 0.5 * (low + high)
        if x * x * (6.0 - 8.0 * x + 3.0 * x * x) < done:
            low = x
        else:
            high = x
    c.since = low * c.duration


@compiled_without_allocation
def _preselect(p: Parameters, c: Any, pedal: float) -> None:
    """Choose the gear of the idle shaft: the next one up under power, the next one down while coasting."""
    if c.gear < 0:
        return
    wish = c.gear + 1 if pedal > 0.0 or c.lever > 0 else c.gear - 1
    if c.gear == 1:
        wish = 2
    if c.gear == p.n_gears:
        wish = c.gear - 1
    if wish != c.preselect:
        c.preselect = wish
        c.preselect_wait = 0.0
    c.preselect_wait += STEP
    delay = _PRESELECT_DELAY if wish > c.gear else 2.0 * _PRESELECT_DELAY
    if c.preselect_wait > delay and c.shifted > _PRESELECT_DELAY:
        c.gear_command[p.gear_shaft[wish]] = wish


@compiled_without_allocation
def decide(
    p: Parameters, c: Any, pedal: float, brake: float, speed: Any, T_e: float, mode: Any, engaged: Any
) -> None:
    """Decide on the next millisecond.

    Args:
        p: parameters.
        c: one `CONTROL` record, renewed in place; its last fields are the commands.
        pedal: 0..1.
        brake: braking force of the driver, N.
        speed: speeds of the plant: engine, damper, shaft 1, shaft 2, output, driven wheels, body.
        T_e: actual engine torque, N·m.
        mode: modes of clutch 1 and 2.
        engaged: engaged gear per shaft.
    """
    w_e, v = speed[0], speed[6]
    c.dw_e += (1.0 - np.exp(-STEP / 0.01)) * ((w_e - c.last_w_e) / STEP - c.dw_e)
    c.dw_w += (1.0 - np.exp(-STEP / 0.04)) * ((speed[5] - c.last_w_w) / STEP - c.dw_w)
    c.last_w_e, c.last_w_w = w_e, speed[5]
    c.since += STEP
    c.shifted += STEP

    shaft = p.gear_shaft[c.gear]
    w_c = speed[2 + shaft]
    slips = w_e - speed[2], w_e - speed[3]
    stuck = mode[shaft] == STUCK
    T_driver = driver_demand(p, pedal, w_e)
    wish = T_driver
    J = p.J_e + p.J_d
    carried = T_e - J * p.ratio[c.gear] * p.final_drive[c.gear] * c.dw_w
    shifting = False
    creep = 0.0
    if c.state >= FILL and c.lever > 0 and c.lever == c.gear and c.target != c.gear:
        _take_back(p, c, T_e, w_c, speed[2 + p.gear_shaft[c.target]])
        shaft = p.gear_shaft[c.gear]
        w_c = speed[2 + shaft]
        stuck = mode[shaft] == STUCK
        carried = T_e - J * p.ratio[c.gear] * p.final_drive[c.gear] * c.dw_w
    if c.lever == NEUTRAL and (c.state == DRIVE or c.state == LAUNCH):
        _enter(c, OPEN)
    if c.state == OPEN:
        creep = _creep(p, c, brake, w_c, engaged)
        if creep > 0.0:
            wish = max(wish, c.capacity[shaft])
        _open(p, c, pedal, brake, v, creep, engaged)
    elif c.state == LAUNCH:
        _launch(p, c, pedal, T_e, w_c, slips[shaft], stuck)
    elif c.state == DRIVE:
        _drive(p, c, pedal, brake, v, carried, w_c, stuck)
    elif c.state == FILL:
        _fill(p, c, T_e, pedal, carried, slips, engaged)
    elif c.state == TORQUE:
        if c.handed_over or not c.torque_first:
            carried = T_e - J * p.ratio[c.target] * p.final_drive[c.target] * c.dw_w
        _hand_over(p, c, carried)
    else:
        new = p.gear_shaft[c.target]
        shifting = True
        wish = _synchronise(p, c, T_e, T_driver, w_c, speed[2 + new], mode[new] == STUCK)
    if c.state >= FILL and w_c < 0.8 * p.idle and pedal == 0.0:  # braked to a stop during a shift
        _enter(c, OPEN)
    if c.state == DRIVE or c.state == LAUNCH:
        _preselect(p, c, pedal)

    # A shift asks for its torque ahead of the engine's lag; the driver's pedal does not.
    c.wish_rate += (1.0 - np.exp(-STEP / 0.02)) * ((wish - c.last_wish) / STEP - c.wish_rate)
    c.last_wish = wish
    lead = p.torque_lag * c.wish_rate if shifting else 0.0
    command = min(full_load(p, w_e), max(closed(p, w_e), wish + lead))
    if not c.engine_on:
        c.engine_command = closed(p, w_e)
    elif w_e < CRANKED:
        c.engine_command = starter(w_e)
    else:
        c.engine_command = with_idle_control(p, command, w_e, c.dw_e)

    # The hill holder keeps the brake on until the clutch can carry the car.
    hold = 0.0
    if not c.holder or creep > 0.0:
        c.hold_n = 0.0
    elif c.state == OPEN and abs(v) < _HOLD_SPEED and pedal == 0.0:
        hold = _HOLD * p.weight
    elif c.state == LAUNCH and c.since < 1.5:
        pull = c.capacity[shaft] * abs(p.ratio[c.gear]) * p.final_drive[c.gear] / p.r_w
        if pull * p.gear_efficiency * p.final_drive_efficiency < 0.12 * p.weight:
            hold = min(c.hold_n, _HOLD * p.weight)
    elif c.state == OPEN:
        hold = c.hold_n
    c.hold_n = _approach(c.hold_n, hold, (0.6 if hold > c.hold_n else 3.0) * p.weight * STEP)
