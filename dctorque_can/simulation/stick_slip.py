"""Stick-slip by events: the exact instants of every lock and release of dry friction contacts.

While a contact of a `Mechanism` slips its torque is the kinetic capacity along the slip; while it sticks its
torque is whatever keeps the slip at zero, up to the static capacity. There is no smoothed sign function: within
one mode the motion is linear, and a step ends where the mode changes.

Integrator: the two-stage, second order, L-stable, stiffly accurate SDIRK method of Alexander (1977). Very stiff
parts (an output shaft of 0.0002 kg·m² behind 50 N·m·s) settle in one step instead of ringing, and sticking holds
exactly at the end of every step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.simulation.mechanism import (
    BACKWARD,
    FORWARD,
    FREE,
    STUCK,
    Floats,
    Loads,
    Mechanism,
    Motion,
    Scratch,
)

GAMMA = 1.0 - 0.5**0.5
_MAX_EVENTS = 40  # in one step; after that what has come to rest stays so until the step ends
_ROOT_ITERATIONS = 60


@compiled_without_allocation
def _factorise(mechanism: Mechanism, mode: NDArray[np.int64], h: float, scratch: Scratch) -> int:
    """Set up and factorise the matrix of both stages of a step of ``h``; return its size.

    Speeds come first, then one row and column per stuck contact. Without pivoting: the speed block is dominated
    by mass and damping, and its Schur complement is that of a constraint.
    """
    a = scratch.matrix
    n, s = mechanism.mass.size, mechanism.stiffness.size
    gh = GAMMA * h
    size = n
    for i in range(mode.size):
        if mode[i] == STUCK:
            size += 1
    for i in range(size):
        for j in range(size):
            a[i, j] = 0.0
    for i in range(n):
        a[i, i] = mechanism.mass[i]
    for p in range(s):
        stiff = gh * mechanism.damping[p] + gh * gh * mechanism.stiffness[p] / (1.0 + gh * mechanism.leak[p])
        for i in range(n):
            row = mechanism.spring_torque[p, i] * stiff
            if row != 0.0:
                for j in range(n):
                    a[i, j] += row * mechanism.spring_speed[p, j]
    border = n
    for c in range(mode.size):
        if mode[c] == STUCK:
            for i in range(n):
                a[i, border] = mechanism.contact[c, i]
                a[border, i] = mechanism.contact[c, i]
            border += 1
    for k in range(size):
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, size):
            factor = a[i, k] * inverse
            a[i, k] = factor
            if factor != 0.0:
                for j in range(k + 1, size):
                    a[i, j] -= factor * a[k, j]
    return size


@compiled_without_allocation
def _stage(
    mechanism: Mechanism,
    mode: NDArray[np.int64],
    loads: Loads,
    h: float,
    fraction: float,
    size: int,
    stage: int,
    scratch: Scratch,
) -> None:
    """Solve one stage from ``base_speed`` and ``base_twist``, loads taken at ``fraction`` of the whole step."""
    n, s, m = mechanism.mass.size, mechanism.stiffness.size, mode.size
    gh = GAMMA * h
    x, torque, twist = scratch.unknowns, scratch.torque, scratch.twist
    for i in range(n):
        force = loads.force[0, i] + fraction * (loads.force[1, i] - loads.force[0, i])
        x[stage, i] = mechanism.mass[i] * scratch.base_speed[i] + gh * force
    for i in range(n, size):
        x[stage, i] = 0.0
    for p in range(s):
        held = gh * mechanism.stiffness[p] * scratch.base_twist[p] / (1.0 + gh * mechanism.leak[p])
        for i in range(n):
            x[stage, i] -= mechanism.spring_torque[p, i] * held
    for c in range(m):
        if mode[c] == FORWARD or mode[c] == BACKWARD:
            capacity = loads.kinetic[0, c] + fraction * (loads.kinetic[1, c] - loads.kinetic[0, c])
            torque[stage, c] = mode[c] * capacity
            for i in range(n):
                x[stage, i] -= gh * mechanism.contact[c, i] * torque[stage, c]
        else:
            torque[stage, c] = 0.0
    a = scratch.matrix
    for i in range(1, size):
        for j in range(i):
            x[stage, i] -= a[i, j] * x[stage, j]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            x[stage, i] -= a[i, j] * x[stage, j]
        x[stage, i] /= a[i, i]
    border = n
    for c in range(m):
        if mode[c] == STUCK:
            torque[stage, c] = x[stage, border] / gh
            border += 1
    for p in range(s):
        rate = 0.0
        for i in range(n):
            rate += mechanism.spring_speed[p, i] * x[stage, i]
        twist[stage, p] = (scratch.base_twist[p] + gh * rate) / (1.0 + gh * mechanism.leak[p])


@compiled_without_allocation
def _attempt(
    mechanism: Mechanism, motion: Motion, loads: Loads, start: float, h: float, whole: float, scratch: Scratch
) -> None:
    """Try a step of ``h`` from ``start`` within the whole step, in the present modes, into ``scratch``."""
    n, s = mechanism.mass.size, mechanism.stiffness.size
    size = _factorise(mechanism, motion.mode, h, scratch)
    for i in range(n):
        scratch.base_speed[i] = motion.speed[i]
    for p in range(s):
        scratch.base_twist[p] = motion.twist[p]
    _stage(mechanism, motion.mode, loads, h, (start + GAMMA * h) / whole, size, 0, scratch)
    weight = (1.0 - GAMMA) / GAMMA
    for i in range(n):
        scratch.base_speed[i] += weight * (scratch.unknowns[0, i] - motion.speed[i])
    for p in range(s):
        scratch.base_twist[p] += weight * (scratch.twist[0, p] - motion.twist[p])
    _stage(mechanism, motion.mode, loads, h, (start + h) / whole, size, 1, scratch)


@compiled_without_allocation
def _slip(mechanism: Mechanism, speed: Floats, c: int) -> float:
    slip = 0.0
    for i in range(mechanism.mass.size):
        slip += mechanism.contact[c, i] * speed[i]
    return slip


@compiled_without_allocation
def _slip_in(mechanism: Mechanism, scratch: Scratch, stage: int, c: int) -> float:
    """Return the slip of contact ``c`` in a stage of the trial step."""
    slip = 0.0
    for i in range(mechanism.mass.size):
        slip += mechanism.contact[c, i] * scratch.unknowns[stage, i]
    return slip


@compiled_without_allocation
def _margin_after(
    mechanism: Mechanism, motion: Motion, loads: Loads, fraction: float, c: int, scratch: Scratch
) -> float:
    """Return how far contact ``c`` is from a change of mode after the trial step; negative: beyond it."""
    if motion.mode[c] == STUCK:
        static = loads.static[0, c] + fraction * (loads.static[1, c] - loads.static[0, c])
        return float(static - abs(scratch.torque[1, c]))
    return float(motion.mode[c] * _slip_in(mechanism, scratch, 1, c))


@compiled_without_allocation
def _margin_now(mechanism: Mechanism, motion: Motion, loads: Loads, fraction: float, c: int) -> float:
    """Return the same before the step, never negative."""
    if motion.mode[c] == STUCK:
        static = loads.static[0, c] + fraction * (loads.static[1, c] - loads.static[0, c])
        return float(max(0.0, static - abs(motion.torque[c])))
    return float(max(0.0, motion.mode[c] * _slip(mechanism, motion.speed, c)))


@compiled_without_allocation
def _accept(
    mechanism: Mechanism, motion: Motion, loads: Loads, start: float, h: float, whole: float, scratch: Scratch
) -> None:
    """Take the trial step over and book its energy with the integrator's own weights."""
    n, s, m = mechanism.mass.size, mechanism.stiffness.size, motion.mode.size
    for stage in range(2):
        share = (1.0 - GAMMA if stage == 0 else GAMMA) * h
        fraction = (start + (GAMMA * h if stage == 0 else h)) / whole
        w = scratch.unknowns
        for i in range(n):
            force = loads.force[0, i] + fraction * (loads.force[1, i] - loads.force[0, i])
            motion.work[i] += share * force * w[stage, i]
        for p in range(s):
            rate = 0.0
            loaded = 0.0
            for i in range(n):
                rate += mechanism.spring_speed[p, i] * w[stage, i]
                loaded += mechanism.spring_torque[p, i] * w[stage, i]
            elastic = mechanism.stiffness[p] * scratch.twist[stage, p]
            damped = mechanism.damping[p] * rate
            motion.spring_heat[p] += share * (
                damped * rate + elastic * mechanism.leak[p] * scratch.twist[stage, p]
            )
            motion.gear_heat[p] += share * (elastic + damped) * (loaded - rate)
        for c in range(m):
            motion.contact_heat[c] += share * scratch.torque[stage, c] * _slip_in(mechanism, scratch, stage, c)
    for i in range(n):
        motion.speed[i] = scratch.unknowns[1, i]
    for p in range(s):
        motion.twist[p] = scratch.twist[1, p]
    for c in range(m):
        motion.torque[c] = scratch.torque[1, c]


@compiled_without_allocation
def _settle(mechanism: Mechanism, motion: Motion, loads: Loads, fraction: float, scratch: Scratch) -> None:
    """Release, worst first, the stuck contacts that would have to carry more than their static capacity now."""
    n, s, m = mechanism.mass.size, mechanism.stiffness.size, motion.mode.size
    net, small, torque, index = scratch.net, scratch.small, scratch.needed, scratch.stuck
    while True:
        stuck = 0
        for c in range(m):
            if motion.mode[c] == STUCK:
                index[stuck] = c
                stuck += 1
        if stuck == 0:
            return
        for i in range(n):
            net[i] = loads.force[0, i] + fraction * (loads.force[1, i] - loads.force[0, i])
        for p in range(s):
            rate = 0.0
            for i in range(n):
                rate += mechanism.spring_speed[p, i] * motion.speed[i]
            tau = mechanism.stiffness[p] * motion.twist[p] + mechanism.damping[p] * rate
            for i in range(n):
                net[i] -= mechanism.spring_torque[p, i] * tau
        for c in range(m):
            if motion.mode[c] == FORWARD or motion.mode[c] == BACKWARD:
                capacity = loads.kinetic[0, c] + fraction * (loads.kinetic[1, c] - loads.kinetic[0, c])
                for i in range(n):
                    net[i] -= mechanism.contact[c, i] * motion.mode[c] * capacity
        for a in range(stuck):
            torque[a] = 0.0
            for i in range(n):
                torque[a] += mechanism.contact[index[a], i] * net[i] / mechanism.mass[i]
            for b in range(stuck):
                small[a, b] = 0.0
                for i in range(n):
                    small[a, b] += (
                        mechanism.contact[index[a], i] * mechanism.contact[index[b], i] / mechanism.mass[i]
                    )
        for k in range(stuck):
            for a in range(k + 1, stuck):
                factor = small[a, k] / small[k, k]
                for b in range(k, stuck):
                    small[a, b] -= factor * small[k, b]
                torque[a] -= factor * torque[k]
        for a in range(stuck - 1, -1, -1):
            for b in range(a + 1, stuck):
                torque[a] -= small[a, b] * torque[b]
            torque[a] /= small[a, a]
        worst = -1
        excess = 0.0
        for a in range(stuck):
            c = index[a]
            motion.torque[c] = torque[a]
            static = loads.static[0, c] + fraction * (loads.static[1, c] - loads.static[0, c])
            if abs(torque[a]) - static > excess:
                excess = abs(torque[a]) - static
                worst = a
        if worst < 0:
            return
        motion.mode[index[worst]] = FORWARD if torque[worst] > 0.0 else BACKWARD
        motion.events[1] += 1


@compiled_without_allocation
def _locate(
    mechanism: Mechanism,
    motion: Motion,
    loads: Loads,
    start: float,
    h: float,
    whole: float,
    c: int,
    scratch: Scratch,
) -> float:
    """Return the length of step, below ``h``, at which contact ``c`` changes its mode (Illinois method)."""
    low, high = 0.0, h
    g_low = _margin_now(mechanism, motion, loads, start / whole, c)
    g_high = _margin_after(mechanism, motion, loads, (start + h) / whole, c, scratch)
    if g_low <= 0.0:
        return 0.0
    side = 0
    for _ in range(_ROOT_ITERATIONS):
        middle = (low * g_high - high * g_low) / (g_high - g_low)
        if not low < middle < high or high - low < 1e-14 * whole:
            break
        _attempt(mechanism, motion, loads, start, middle, whole, scratch)
        g = _margin_after(mechanism, motion, loads, (start + middle) / whole, c, scratch)
        if g < 0.0:
            high, g_high = middle, g
            if side < 0:
                g_low *= 0.5
            side = -1
        elif g > 0.0:
            low, g_low = middle, g
            if side > 0:
                g_high *= 0.5
            side = 1
        if abs(g) < 1e-11:
            return middle
    return high


@compiled_without_allocation
def _wake(mechanism: Mechanism, motion: Motion, loads: Loads) -> None:
    """Give every contact that gains or loses its capacity in this step the mode that goes with it."""
    for c in range(motion.mode.size):
        capable = loads.kinetic[0, c] > 0.0 or loads.kinetic[1, c] > 0.0
        if not capable:
            motion.mode[c] = FREE
            motion.torque[c] = 0.0
        elif motion.mode[c] == FREE:
            slip = _slip(mechanism, motion.speed, c)
            motion.mode[c] = STUCK if slip == 0.0 else (FORWARD if slip > 0.0 else BACKWARD)


@compiled_without_allocation
def advance(mechanism: Mechanism, motion: Motion, loads: Loads, whole: float, scratch: Scratch) -> None:
    """Advance ``motion`` by ``whole`` seconds through every lock and release on the way.

    Args:
        mechanism: the bodies, springs and contacts.
        motion: renewed in place.
        loads: forces and capacities at both ends of the step.
        whole: length of the step, s.
        scratch: working memory of `new_scratch`.
    """
    m = motion.mode.size
    _wake(mechanism, motion, loads)
    _settle(mechanism, motion, loads, 0.0, scratch)
    start = 0.0
    events = 0
    while start < whole:
        h = whole - start
        event = -1
        _attempt(mechanism, motion, loads, start, h, whole, scratch)
        found = events < _MAX_EVENTS
        while found:
            found = False
            for c in range(m):
                if motion.mode[c] != FREE and c != event:
                    margin = _margin_after(mechanism, motion, loads, (start + h) / whole, c, scratch)
                    if margin < -1e-9:
                        h = _locate(mechanism, motion, loads, start, h, whole, c, scratch)
                        event = c
                        if h > 0.0:
                            _attempt(mechanism, motion, loads, start, h, whole, scratch)
                            found = True
                        break
        if h > 0.0:
            _accept(mechanism, motion, loads, start, h, whole, scratch)
            start = whole if event < 0 else start + h
        if event >= 0:
            events += 1
            if motion.mode[event] == STUCK:
                motion.mode[event] = FORWARD if motion.torque[event] > 0.0 else BACKWARD
                motion.events[1] += 1
            else:
                motion.mode[event] = STUCK
                motion.events[0] += 1
                if events < _MAX_EVENTS:
                    _settle(mechanism, motion, loads, min(1.0, start / whole), scratch)
