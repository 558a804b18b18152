"""Speeds without sign of a shaft that winds up while the car stands."""

import numpy as np
import pytest

from dctorque_can.estimators import contract
from dctorque_can.estimators.inputs import SPEED_1
from dctorque_can.estimators.kalman.magnitudes import measure_magnitude
from dctorque_can.estimators.kalman.model import State

from .test_gearbox import new_filter


def told(f, tuning, speed, closed=True):
    """Tell a speed of input shaft 1, whose clutch slips by some 190 rad/s."""
    inputs = np.zeros(1, contract.INPUTS).view(np.recarray)[0]
    inputs.value[SPEED_1], inputs.fresh[SPEED_1], inputs.closed[0] = speed, True, closed
    measure_magnitude(inputs, f, tuning, SPEED_1, 1, State.W_C1, 2000.0)


@pytest.fixture
def standing():
    """A filter that takes 9 rad/s for −9 rad/s, and so a clutch for one that pulls against its friction."""
    k = new_filter()
    f, tuning = k.state.view(np.recarray)[0], k.tuning.view(np.recarray)[0]
    f.x[State.W_C1], f.x[State.T_C1], f.x[State.TH_O] = -9.0, -22.0, -0.04
    f.P[State.W_C1, State.W_C1], f.P[State.T_C1, State.T_C1] = 0.1**2, 3.0**2
    return f, tuning


def test_no_clutch_pulls_against_its_friction(standing):
    """22 ± 3 N·m against the slip: the shaft turns the other way, and nothing is known of its driveline."""
    f, tuning = standing
    told(f, tuning, 9.0)
    assert f.x[State.W_C1] == 9.0
    assert f.x[State.T_C1] == f.x[State.TH_O] == 0.0
    assert f.P[State.T_C1, State.T_C1] == 200.0**2
    assert f.P[State.T_X, State.T_X] == 2000.0**2


@pytest.mark.parametrize(
    ("torque", "sigma", "closed"), [(-6.0, 3.0, True), (22.0, 3.0, True), (-22.0, 3.0, False)]
)
def test_else_it_has_the_sign_that_is_clear(standing, torque, sigma, closed):
    f, tuning = standing
    f.x[State.T_C1], f.P[State.T_C1, State.T_C1] = torque, sigma**2
    told(f, tuning, 9.2, closed)
    assert -9.2 < f.x[State.W_C1] < -9.0
    assert f.x[State.T_C1] == pytest.approx(torque, abs=1e-6)


def expected(f, x, sigma):
    """Let input shaft 1 be expected at x ± σ rad/s, whatever the rest does."""
    f.x[State.W_C1] = x
    f.P[State.W_C1, :] = f.P[:, State.W_C1] = 0.0
    f.P[State.W_C1, State.W_C1] = sigma**2


def known(f):
    """Return what is known of the speed of input shaft 1: mean and standard deviation, rad/s."""
    return f.x[State.W_C1], np.sqrt(f.P[State.W_C1, State.W_C1])


@pytest.mark.parametrize(("x", "sigma", "speed"), [(1.0, 1.0, 1.2), (-0.4, 0.5, 0.8), (0.3, 0.2, 0.35)])
def test_of_a_doubtful_sign_mean_and_variance_of_both_are_kept(standing, x, sigma, speed):
    """Bayes on a grid: |w + n| was told, n of the sensor's noise."""
    f, tuning = standing
    expected(f, x, sigma)
    R = tuning.speed_variance[1]
    w = np.linspace(x - 8.0 * sigma, x + 8.0 * sigma, 20001)
    density = np.exp(-0.5 * ((w - x) / sigma) ** 2) * sum(
        np.exp(-0.5 * (w - sign * speed) ** 2 / R) for sign in (1.0, -1.0)
    )
    density /= density.sum()
    mean = (density * w).sum()
    told(f, tuning, speed, closed=False)
    assert known(f) == pytest.approx((mean, np.sqrt((density * (w - mean) ** 2).sum())), rel=1e-3)


@pytest.mark.parametrize(("x", "speed"), [(0.0, 0.0), (0.0, 0.3), (0.02, 0.2), (5.0, 0.0)])
def test_what_may_be_zero_says_nothing(standing, x, speed):
    """Slow teeth are not seen, and noise of a rest has either sign."""
    f, tuning = standing
    expected(f, x, 0.3)
    told(f, tuning, speed, closed=False)
    assert known(f) == pytest.approx((x, 0.3), abs=1e-12)


def test_a_shaft_that_may_turn_either_way_turns_as_its_clutch_pulls(standing):
    """3 rad/s where 0 ± 3 were expected: forwards with the odds exp(2); either way while nothing pulls."""
    f, tuning = standing
    f.x[State.T_C1] = 0.0
    expected(f, 0.0, 3.0)
    told(f, tuning, 3.5)
    assert known(f)[0] == pytest.approx(3.5 * np.tanh(1.0), rel=0.01)
    expected(f, 0.0, 3.0)
    told(f, tuning, 3.5, closed=False)
    assert known(f) == pytest.approx((0.0, 3.0))


def test_a_motion_that_was_not_expected_is_believed_at_its_third_speed(standing):
    """Some 9 rad/s while the model lets the shaft stop from 4 rad/s in 3 ms: else it was mirrored soon."""
    f, tuning = standing
    for x, speed, left_at in ((4.0, 9.0, 4.0), (2.5, 8.8, 2.5), (1.0, 8.6, 8.6)):
        f.t_us += 1000
        expected(f, x, 0.2)
        told(f, tuning, speed, closed=False)
        assert known(f)[0] == pytest.approx(left_at, abs=0.1)
