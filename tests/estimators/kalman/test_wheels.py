"""What the filter takes from the two wheels of an axle while tyres slip."""

import numpy as np
import pytest

from dctorque_can.estimators import contract
from dctorque_can.estimators.inputs import WHEEL
from dctorque_can.estimators.kalman import wheels
from dctorque_can.estimators.kalman.faults import SensorFault
from dctorque_can.estimators.kalman.model import State

from .test_gearbox import new_filter

DRIVEN, AXLE = 3, 0  # place among the sensors, and the front axle


@pytest.mark.parametrize(("spin_rate", "expected"), [(5000.0, SensorFault.NONE), (0.0, SensorFault.SPIKE)])
def test_wheels_that_have_just_spun_differ_by_their_slip(spin_rate, expected):
    """The left one comes down to the other's speed: that is no jump, but without any slip before it is one."""
    k = new_filter()
    f, tuning = k.state.view(np.recarray)[0], k.tuning.view(np.recarray)[0]
    inputs = np.zeros(1, contract.INPUTS).view(np.recarray)[0]
    inputs.available[:] = True
    f.x[State.W_B] = f.x[State.W_W] = 2.75
    f.spin_rate = spin_rate
    for left in (3.42, 3.1, 2.7):
        f.t_us += 20_000
        f.P[State.W_W, State.W_W] = 1.0
        inputs.t_us = f.t_us
        inputs.fresh[:] = True
        inputs.seen_us[:] = f.t_us
        inputs.value[WHEEL], inputs.value[WHEEL + 1] = left, 2.75
        wheels.measure_axle(inputs, f, tuning, WHEEL, True, DRIVEN)
    assert f.fault[DRIVEN] == expected
    assert bool(f.spread_known[AXLE]) == (expected == SensorFault.SPIKE)
