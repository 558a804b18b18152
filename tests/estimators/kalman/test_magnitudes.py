"""Speeds without sign of a shaft that winds up while the car stands."""

import numpy as np
import pytest

from dctorque_can.estimators import contract
from dctorque_can.estimators.inputs import SPEED_1
from dctorque_can.estimators.kalman import frame
from dctorque_can.estimators.kalman.model import State

from .test_gearbox import new_filter


def told(f, tuning, speed, closed=True):
    """Tell 9 rad/s of input shaft 1, whose clutch slips by some 190 rad/s."""
    inputs = np.zeros(1, contract.INPUTS).view(np.recarray)[0]
    inputs.value[SPEED_1], inputs.fresh[SPEED_1], inputs.closed[0] = speed, True, closed
    frame.measure_magnitude(inputs, f, tuning, SPEED_1, 1, State.W_C1)


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
