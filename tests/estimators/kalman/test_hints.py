"""Weak measurements against the body's balance, and what they may never claim."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.driveline.parameters import AIR_DENSITY, STANDARD_GRAVITY
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman import hints
from dctorque_can.estimators.kalman.model import State
from dctorque_can.estimators.kalman.tuning import tuning as tuning_of
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("avante_dct7")).settings
VEHICLE, CHASSIS = SETTINGS.vehicle, SETTINGS.vehicle.chassis
DESIGN = replace(SETTINGS.kalman, parameter_error_share=0.0, command_error_share=0.2)
TABLES = kalman.new(VEHICLE, DESIGN).tables
OPEN, SLIPPING, LOCKED = 0, 1, 2
ARM = CHASSIS.mass_kg * CHASSIS.wheel_radius_m


def new_filter(**changes):
    k = kalman.Kalman(np.zeros(1, kalman.FILTER), tuning_of(VEHICLE, replace(DESIGN, **changes)), TABLES)
    f = k.state[0]
    f["gear"][:] = 1, 2
    kalman.start(f, k.tuning[0], 200.0, 150.0, 100.0, 30.0, 80.0)
    return f, k.tuning[0]


def on_the_road(grade, w_dot, w=30.0):
    """Tyre torque, road load and specific force of a car that accelerates uphill, by Newton's law in newtons."""
    weight = CHASSIS.mass_kg * STANDARD_GRAVITY
    air = (
        0.5 * AIR_DENSITY * CHASSIS.drag_coefficient * CHASSIS.frontal_area_m2 * (CHASSIS.wheel_radius_m * w) ** 2
    )
    held_back = weight * math.sin(grade) + math.copysign(CHASSIS.rolling_resistance * weight + air, w)
    at_the_wheels = CHASSIS.mass_kg * CHASSIS.wheel_radius_m * w_dot + held_back
    undriven = 0.5 * CHASSIS.wheel_inertia_kgm2 * w_dot
    force = CHASSIS.wheel_radius_m * w_dot + STANDARD_GRAVITY * math.sin(grade)
    return CHASSIS.wheel_radius_m * at_the_wheels + undriven, CHASSIS.wheel_radius_m * held_back, force


@pytest.mark.parametrize(("grade", "w_dot", "w"), [(0.06, 4.0, 30.0), (-0.04, -2.0, 80.0), (0.1, 1.0, -5.0)])
def test_what_is_true_is_no_surprise(grade, w_dot, w):
    """A state that is right is left as it is, and known better; a wrong one is drawn towards the truth."""
    T_x, T_v, force = on_the_road(grade, w_dot, w)
    for take, value, i, true in (
        (hints.take_acceleration, force, State.T_X, T_x),
        (hints.take_grade, grade, State.T_V, T_v),
    ):
        f, tuning = new_filter()
        f["x"][[State.T_X, State.T_V, State.W_B]] = T_x, T_v, w
        f["t_us"] = 20_000
        before = f["P"][i, i]
        take(f, tuning, value)
        np.testing.assert_allclose(f["x"][i], true, rtol=1e-12)
        assert f["P"][i, i] < before
        f["x"][i] = true + 300.0
        take(f, tuning, value)
        assert true < f["x"][i] < true + 300.0


@pytest.mark.parametrize("period_us", [10_000, 20_000, 100_000])
def test_information_comes_with_time_not_with_messages(period_us):
    """After t of the same value the hint says 1/variance = t/(2 τ σ²), whatever its period is: exact by hand."""
    f, tuning = new_filter(inertial_error_time_s=5.0, acceleration_error_m_s2=0.3)
    f["P"][:] = 0.0
    f["P"][State.T_X, State.T_X] = 2000.0**2
    for k in range(1, 2_000_000 // period_us + 1):
        f["t_us"] = k * period_us
        hints.take_acceleration(f, tuning, 1.0)
    information = 1.0 / 2000.0**2 + 2.0 / (2.0 * 5.0 * (0.3 * ARM) ** 2)
    np.testing.assert_allclose(f["P"][State.T_X, State.T_X], 1.0 / information, rtol=1e-9)


@pytest.mark.parametrize("value", [math.nan, 25.0, -25.0])
def test_a_hint_beyond_all_reason_is_left_out(value):
    f, tuning = new_filter()
    f["P"][State.T_X, State.T_X] = 100.0**2
    before = f["x"].copy(), f["P"].copy()
    f["t_us"] = 20_000
    hints.take_acceleration(f, tuning, value)
    np.testing.assert_array_equal(f["x"], before[0])
    np.testing.assert_array_equal(f["P"], before[1])


@pytest.mark.parametrize(
    ("phase", "slip", "torque", "command", "drawn"),
    [
        (SLIPPING, 50.0, 60.0, 100.0, 100.0),  # what is commanded is carried …
        (SLIPPING, -50.0, -60.0, 100.0, -100.0),  # … against the slip
        (SLIPPING, 5.0, 60.0, 100.0, None),  # its direction is not certain
        (LOCKED, 0.0, 60.0, 100.0, None),  # a locked clutch carries less than it could
        (LOCKED, 0.0, 160.0, 100.0, 100.0),  # … and no more
        (LOCKED, 0.0, -160.0, 100.0, -100.0),
        (LOCKED, 0.0, 110.0, 100.0, None),  # within the error of the command: 5 N·m and a fifth
        (OPEN, 50.0, 60.0, 100.0, None),
        (SLIPPING, 50.0, 60.0, -40.0, 0.0),  # a negative command holds it open
    ],
)
def test_command(phase, slip, torque, command, drawn):
    f, tuning = new_filter()
    f["x"][State.W_E] = f["x"][State.W_C1] + slip
    f["x"][State.T_C1] = torque
    f["t_us"] = 10_000
    hints.take_command(f, tuning, 0, phase, command)
    if drawn is None:
        assert f["x"][State.T_C1] == torque
    else:
        assert min(torque, drawn) < f["x"][State.T_C1] < max(torque, drawn)


def test_a_command_that_has_just_changed_says_little():
    """A clutch lags behind: of a step of 200 N·m that has just come all is on its way."""
    known = []
    for first in (200.0, 0.0):
        f, tuning = new_filter(command_lag_s=0.05)
        f["x"][State.W_E] = f["x"][State.W_C1] + 50.0
        f["x"][State.T_C1], f["P"][State.T_C1, State.T_C1] = 100.0, 100.0**2
        f["t_us"] = 10_000
        hints.take_command(f, tuning, 0, OPEN, first)
        f["t_us"] = 20_000
        hints.take_command(f, tuning, 0, SLIPPING, 200.0)
        known.append(1.0 / f["P"][State.T_C1, State.T_C1] - 1.0 / 100.0**2)
    ratio = (5.0**2 + 200.0**2) / (5.0 + 0.2 * 200.0) ** 2
    np.testing.assert_allclose(known[0] / known[1], ratio, rtol=1e-6)
