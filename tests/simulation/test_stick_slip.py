"""The stick-slip solver against closed forms and against a published simulation of another tool."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dctorque_can.simulation.mechanism import (
    BACKWARD,
    FORWARD,
    FREE,
    STUCK,
    Loads,
    Mechanism,
    Motion,
    Scratch,
    new_loads,
    new_motion,
    new_scratch,
)
from dctorque_can.simulation.stick_slip import advance

GOLDEN = Path(__file__).parents[1] / "golden"
Floats = NDArray[np.float64]


def without_springs(mass: list[float], contact: list[list[float]]) -> Mechanism:
    n = len(mass)
    none = np.zeros((0, n))
    return Mechanism(
        np.array(mass), none, none, np.zeros(0), np.zeros(0), np.zeros(0), np.array(contact, dtype=float)
    )


def parts(mechanism: Mechanism) -> tuple[Motion, Loads, Scratch]:
    n, s, m = len(mechanism.mass), len(mechanism.stiffness), len(mechanism.contact)
    return new_motion(n, s, m), new_loads(n, m), new_scratch(n, s, m)


def test_follows_the_published_coupled_clutches_through_every_lock_and_release() -> None:
    reference = np.genfromtxt(GOLDEN / "coupled_clutches.csv", delimiter=",", names=True, deletechars="")
    mechanism = without_springs([1.0] * 4, [[1, -1, 0, 0], [0, 1, -1, 0], [0, 0, 1, -1]])
    motion, loads, scratch = parts(mechanism)
    motion.speed[0] = 10.0
    motion.mode[:] = FORWARD, FREE, FREE

    def capacity(t: float) -> list[float]:
        return [max(0.0, 10 * np.cos(0.4 * np.pi * t)), 10.0 * (t >= 0.4 - 1e-9), 10.0 * (t >= 0.9 - 1e-9)]

    h = 2e-4
    speeds, modes = [motion.speed.copy()], [motion.mode.copy()]
    for i in range(7500):
        t = i * h
        loads.force[:, 0] = 10 * np.sin(10 * np.pi * t), 10 * np.sin(10 * np.pi * (t + h))
        loads.kinetic[0] = capacity(t)
        loads.kinetic[1, 0] = capacity(t + h)[0]
        loads.kinetic[1, 1:] = loads.kinetic[0, 1:]
        loads.static[:] = 1.1 * loads.kinetic
        advance(mechanism, motion, loads, h, scratch)
        if i % 10 == 9:
            speeds.append(motion.speed.copy())
            modes.append(motion.mode.copy())
    speed, mode = np.array(speeds), np.array(modes)

    assert len(speed) == len(reference)
    np.testing.assert_allclose(speed[:, 0], reference["J1.w"], atol=2e-4)
    for clutch in (1, 2, 3):
        slip = speed[:, clutch] - speed[:, clutch - 1]
        np.testing.assert_allclose(slip, reference[f"clutch{clutch}.w_rel"], atol=2e-4)
        theirs = reference[f"clutch{clutch}.mode"]
        ours = np.where(mode[:, clutch - 1] == FREE, 2, -mode[:, clutch - 1])  # their slip has the other sign
        assert np.sum(ours != theirs) <= 8, f"clutch {clutch}"  # an instant of change may fall on either side


def test_locks_and_slips_again_at_the_instants_of_the_closed_form() -> None:
    # J1 at 10 rad/s against a clutch of 20 N·m: slip ends at t = 10 / (20/1 + 20/3). Then a torque that grows by
    # 100 N·m/s on J1 needs λ = J2/(J1+J2) · 100 t in the clutch, which breaks at the static capacity of 24 N·m.
    J1, J2, kinetic, static, growth, h = 1.0, 3.0, 20.0, 24.0, 100.0, 1e-3
    mechanism = without_springs([J1, J2], [[1, -1]])
    motion, loads, scratch = parts(mechanism)
    motion.speed[:] = 10.0, 0.0
    motion.mode[0] = FORWARD
    loads.kinetic[:] = kinetic
    loads.static[:] = static
    t_lock = 10.0 / (kinetic / J1 + kinetic / J2)
    for _ in range(400):
        advance(mechanism, motion, loads, h, scratch)
    assert motion.mode[0] == STUCK
    assert motion.speed[1] == pytest.approx(J1 * 10 / (J1 + J2), rel=1e-12)
    assert motion.speed[1] == pytest.approx(kinetic / J2 * t_lock, rel=1e-12)

    t_release = static / growth * (J1 + J2) / J2
    for i in range(400):
        loads.force[:, 0] = growth * i * h, growth * (i + 1) * h
        advance(mechanism, motion, loads, h, scratch)
    t = 0.4
    w_release = J1 * 10 / (J1 + J2) + growth * t_release**2 / 2 / (J1 + J2)
    w1 = w_release + (growth * (t**2 - t_release**2) / 2 - kinetic * (t - t_release)) / J1
    w2 = w_release + kinetic * (t - t_release) / J2
    assert motion.mode[0] == FORWARD
    np.testing.assert_allclose(motion.speed, [w1, w2], rtol=1e-6)
    assert tuple(motion.events) == (1, 1)


def test_slip_that_reverses_passes_through_zero_when_the_clutch_cannot_hold() -> None:
    mechanism = without_springs([1.0, 1.0], [[1, -1]])
    motion, loads, scratch = parts(mechanism)
    motion.speed[:] = 1.0, 0.0
    motion.mode[0] = FORWARD
    loads.kinetic[:] = 1.0
    loads.static[:] = 1.0
    loads.force[:, 0] = -10.0
    for _ in range(20):
        advance(mechanism, motion, loads, 0.01, scratch)
    # Until slip is 0: d slip/dt = −10 − 2; after it: −10 + 2.
    t_zero = 1.0 / 12.0
    assert motion.mode[0] == BACKWARD
    assert motion.speed[0] - motion.speed[1] == pytest.approx(-8.0 * (0.2 - t_zero), rel=1e-9)


def test_two_inertias_start_up_locked_and_rubbing_by_the_closed_form() -> None:
    """A constant torque brings a dragged load up to speed: heat, momentum and lock instant in closed form."""
    J1, J2, T, C, w0 = 0.2, 2.0, 100.0, 150.0, 200.0
    mechanism = without_springs([J1, J2], [[1, -1]])
    motion, loads, scratch = parts(mechanism)
    motion.speed[:] = w0, 0.0
    motion.mode[0] = FORWARD
    loads.kinetic[:] = C
    loads.static[:] = C
    loads.force[:, 0] = T
    t_lock = w0 / ((C - T) / J1 + C / J2)
    for _ in range(1000):
        advance(mechanism, motion, loads, 1e-3, scratch)
    w_lock = C / J2 * t_lock
    np.testing.assert_allclose(motion.speed, w_lock + T / (J1 + J2) * (1.0 - t_lock), rtol=1e-10)
    assert motion.torque[0] == pytest.approx(T * J2 / (J1 + J2), rel=1e-9)
    assert motion.contact_heat[0] == pytest.approx(C * w0 * t_lock / 2, rel=1e-9)


def test_energy_of_a_sprung_slipping_pair_is_all_accounted_for() -> None:
    """Torsional oscillator behind a clutch that locks and breaks away many times."""
    mechanism = Mechanism(
        mass=np.array([0.2, 0.03, 1.5]),
        spring_speed=np.array([[1.0, -1.0, 0.0]]),
        spring_torque=np.array([[1.0, -1.0, 0.0]]),
        stiffness=np.array([1500.0]),
        damping=np.array([0.5]),
        leak=np.array([0.0]),
        contact=np.array([[0.0, 1.0, -1.0]]),
    )
    motion, loads, scratch = parts(mechanism)
    motion.speed[:] = 100.0, 100.0, 0.0
    motion.mode[0] = FORWARD
    h = 1e-4
    before = 0.5 * (mechanism.mass @ motion.speed**2)
    for i in range(10000):
        loads.force[:, 0] = 120 * np.sin(40 * i * h), 120 * np.sin(40 * (i + 1) * h)
        loads.kinetic[:] = 30.0
        loads.static[:] = 33.0
        advance(mechanism, motion, loads, h, scratch)
    stored = 0.5 * (mechanism.mass @ motion.speed**2) + 0.5 * 1500.0 * motion.twist[0] ** 2
    heat = motion.contact_heat.sum() + motion.spring_heat.sum()
    assert motion.events.min() >= 4
    assert stored + heat - before == pytest.approx(motion.work.sum(), abs=1e-4 * motion.contact_heat.sum())


def test_very_stiff_part_settles_instead_of_ringing() -> None:
    """0.0002 kg·m² behind 50 N·m·s · 3.7²: a rate of 3.4e6 1/s with a step of 1e-4 s."""
    b = 50.0 * 3.7**2
    mechanism = Mechanism(
        mass=np.array([1.0, 0.0002]),
        spring_speed=np.array([[1.0, -1.0]]),
        spring_torque=np.array([[1.0, -1.0]]),
        stiffness=np.zeros(1),
        damping=np.array([b]),
        leak=np.zeros(1),
        contact=np.zeros((0, 2)),
    )
    motion, loads, scratch = parts(mechanism)
    motion.speed[:] = 0.0, 10.0
    loads.force[:, 1] = -5.0
    for _ in range(4):
        advance(mechanism, motion, loads, 1e-4, scratch)
    acceleration = -5.0 / 1.0002
    assert motion.speed[1] - motion.speed[0] == pytest.approx((-5.0 - 0.0002 * acceleration) / b, rel=1e-4)
