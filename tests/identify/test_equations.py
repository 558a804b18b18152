"""Single kinds of equations, where the answer is known."""

from dataclasses import replace

import pytest

from dctorque_can.config.load import Config
from dctorque_can.evidence.moments import WHEELS, Moments, moments
from dctorque_can.identify.drive import Drive
from dctorque_can.identify.equations import pairs
from dctorque_can.identify.regression import Belief, solve
from dctorque_can.identify.resistances import drives

LATE_S = 0.007


def test_wheels_of_one_axle_tell_how_late_they_come_against_each_other(
    owned_drive: Moments, owned_truth: Config
) -> None:
    left, right = WHEELS[:2]
    signals = dict(owned_drive.series.signals)
    signals[right] = replace(signals[right], t_s=signals[right].t_s + LATE_S)
    m = moments(replace(owned_drive.series, signals=signals))
    (usual,) = drives([m], owned_truth)
    assert pairs(usual) == []  # in one message they come together
    apart = Drive.of(m, usual.guess, {**usual.message, left: "late left", right: "late right"})
    beliefs = {
        "late left": Belief(0.0, 1e-6),
        "late right": Belief(0.0, 0.02),
        "front_wheels": Belief(0.0, 0.02),
    }
    found = solve(pairs(apart), beliefs).of("late right")
    assert found.value == pytest.approx(LATE_S, abs=2e-4)
    assert abs(found.value - LATE_S) < 3.0 * found.sigma < 1e-3
