"""Bodies, springs and dry friction contacts, their state and their loads, as the stick-slip solver reads them.

A mechanism has ``n`` speeds w, ``s`` springs and ``m`` friction contacts:

    M dw/dt = f(t) − B_fᵀ τ − Dᵀ c,   τ = k δ + b B_v w,   dδ/dt = B_v w − l δ

δ is the twist of a spring, l its leakage (a tyre forgets its deflection as it rolls); B_v and B_f differ where a
lossy gear sits at the spring. Contact i rubs at slip (D w)_i.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase

Floats = NDArray[np.float64]

FORWARD, STUCK, BACKWARD, FREE = 1, 0, -1, 2  # modes of a contact; FREE: no capacity

_OPEN_PHASE, _SLIPPING_PHASE, _LOCKED_PHASE = (int(phase) for phase in ClutchPhase)


class Mechanism(NamedTuple):
    """What does not change within a step.

    Attributes:
        mass: ``[n]`` inertia of each speed.
        spring_speed: B_v ``[s, n]``, rate of twist from speeds.
        spring_torque: B_f ``[s, n]``, how the spring's torque loads each speed; B_v if nothing is lost.
        stiffness: k ``[s]``.
        damping: b ``[s]``.
        leak: l ``[s]`` in 1/s.
        contact: D ``[m, n]``.
    """

    mass: Floats
    spring_speed: Floats
    spring_torque: Floats
    stiffness: Floats
    damping: Floats
    leak: Floats
    contact: Floats


class Motion(NamedTuple):
    """State of a mechanism and its ledger; `advance` renews it in place.

    Attributes:
        speed: w ``[n]``.
        twist: δ ``[s]``.
        mode: int64 ``[m]``: FORWARD, STUCK, BACKWARD, FREE.
        torque: ``[m]``, what each contact carries now, along its slip.
        work: ``[n]``, work done by f, J.
        spring_heat: ``[s]``, by damping and leakage, J.
        gear_heat: ``[s]``, by B_f ≠ B_v, J.
        contact_heat: ``[m]``, J.
        events: int64 ``[2]``, number of locks and of releases so far.
    """

    speed: Floats
    twist: Floats
    mode: NDArray[np.int64]
    torque: Floats
    work: Floats
    spring_heat: Floats
    gear_heat: Floats
    contact_heat: Floats
    events: NDArray[np.int64]


class Loads(NamedTuple):
    """What acts during a step: row 0 at its start, row 1 at its end, linear between.

    Attributes:
        force: f ``[2, n]``.
        kinetic: ``[2, m]``, kinetic capacity, at least 0.
        static: ``[2, m]``, static capacity, at least the kinetic one.
    """

    force: Floats
    kinetic: Floats
    static: Floats


class Scratch(NamedTuple):
    """Room for one trial step, and for which contacts hold, reused."""

    matrix: Floats  # [n + m, n + m], factorised
    unknowns: Floats  # [2, n + m], speeds and contact torques of both stages
    base_speed: Floats  # [n]
    base_twist: Floats  # [s]
    twist: Floats  # [2, s]
    torque: Floats  # [2, m]
    net: Floats  # [n], what acts beside the contacts that stick
    small: Floats  # [m, m], what these do to each other's slips
    needed: Floats  # [m], what each of them would have to carry
    stuck: NDArray[np.int64]  # [m], which contacts they are


def new_motion(n: int, s: int, m: int) -> Motion:
    """Return a motion at rest, all contacts stuck."""
    modes = np.zeros(m, np.int64)
    events = np.zeros(2, np.int64)
    return Motion(
        np.zeros(n), np.zeros(s), modes, np.zeros(m), np.zeros(n), np.zeros(s), np.zeros(s), np.zeros(m), events
    )


def new_loads(n: int, m: int) -> Loads:
    """Return loads of zero."""
    return Loads(np.zeros((2, n)), np.zeros((2, m)), np.zeros((2, m)))


def new_scratch(n: int, s: int, m: int) -> Scratch:
    """Return working memory for a mechanism of this size."""
    total = n + m
    return Scratch(
        np.zeros((total, total)),
        np.zeros((2, total)),
        np.zeros(n),
        np.zeros(s),
        np.zeros((2, s)),
        np.zeros((2, m)),
        np.zeros(n),
        np.zeros((m, m)),
        np.zeros(m),
        np.zeros(m, np.int64),
    )


@compiled_without_allocation
def spring_torque(mechanism: Mechanism, motion: Motion, spring: int) -> float:
    """Return k δ + b dδ/dt of one spring now."""
    rate = 0.0
    for i in range(motion.speed.size):
        rate += mechanism.spring_speed[spring, i] * motion.speed[i]
    return float(mechanism.stiffness[spring] * motion.twist[spring] + mechanism.damping[spring] * rate)


@compiled_without_allocation
def phase_of(mode: int) -> int:
    """Return the `ClutchPhase` of a contact's mode."""
    if mode == FREE:
        return _OPEN_PHASE
    return _LOCKED_PHASE if mode == STUCK else _SLIPPING_PHASE
