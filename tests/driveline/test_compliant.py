"""Section 2.2 against the same car written as Lagrange's equations, and against its energy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dctorque_can.driveline import compliant, conventional

from .lagrange import DAMPER, ENGINE, SHAFT1, SHAFT2, WHEEL, lagrange, matrices, road, rounding
from .segments import (
    BODIES,
    SECONDS,
    SEGMENTS,
    TIGHT,
    compliant_accelerations,
    compliant_run,
    compliant_torques,
)


@pytest.mark.parametrize("name", SEGMENTS)
def test_equations_are_lagranges(name):
    s = SEGMENTS[name]
    t, y = compliant_run(s)
    expected, torque = lagrange(s, t, y)
    ours = compliant_accelerations(s, t, y)
    inertia = matrices(s)[0][:, None]
    of_bodies, of_clutches = rounding(s, t, y)
    assert of_bodies.max() < 1e-6  # N·m, of thousands: less than any wrong term
    assert np.all(np.abs(inertia * (ours - expected)) <= of_bodies)
    assert np.all(np.abs(np.array(compliant_torques(s, t, y)[-2:]) - torque) <= of_clutches)


@pytest.mark.parametrize("name", SEGMENTS)
def test_energy_closes(name):
    """Engine work is work against the road, kinetic and elastic energy, and heat of dampers and clutches."""
    s = SEGMENTS[name]
    masses, g, k, b = matrices(s)
    speeds_0 = s.speeds()
    clutch = [SHAFT1, SHAFT2]

    def right_hand_side(t, y):
        speeds = y[BODIES : 2 * BODIES]
        T_c = np.array(compliant_torques(s, t, y)[-2:])
        heat = b @ (g @ speeds) ** 2 + T_c @ (speeds[DAMPER] - speeds[clutch])
        power = [s.engine_torque(t) * speeds[ENGINE], road(s, speeds[WHEEL]) * speeds[WHEEL], heat]
        return np.concatenate((speeds, compliant_accelerations(s, t, y), power))

    y = solve_ivp(right_hand_side, (0.0, SECONDS), [*np.zeros(BODIES), *speeds_0, 0, 0, 0], **TIGHT).y[:, -1]
    kinetic = 0.5 * masses @ (y[BODIES : 2 * BODIES] ** 2 - speeds_0**2)
    elastic = 0.5 * k @ (g @ y[:BODIES]) ** 2
    work, against_road, heat = y[-3:]
    assert work > 3000.0
    assert heat > 10.0
    assert work == pytest.approx(against_road + kinetic + elastic + heat, abs=1e-3)


def test_numbers_and_arrays_give_the_same():
    s = SEGMENTS["avante, 1 locked"]
    t, y = compliant_run(s)
    together = compliant_accelerations(s, t, y)
    one_by_one = np.array([compliant_accelerations(s, t[k], y[:, k]) for k in range(len(t))]).T
    np.testing.assert_allclose(together, one_by_one, rtol=1e-13)
    p = s.pair
    grid = compliant.transfer_shaft_torque(np.zeros((3, 1)), np.ones((1, 4)), 0.5, p.i_t1, p.i_f1, 1e4, 50.0)
    assert np.shape(grid) == (3, 4)
    assert isinstance(conventional.slipping_clutch_torque(50.0, -2.0), float)
