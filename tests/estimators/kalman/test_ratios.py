"""What was learned of a gear's ratio comes back with the gear."""

import numpy as np
import pytest

from dctorque_can.estimators.contract import ANSWER
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman import frame, gearbox, ratios
from dctorque_can.estimators.kalman.model import LATE, RATIO_1, RATIO_2, SCALE
from dctorque_can.pipeline.estimates import HEALTH

from .test_filter import DESIGN, VEHICLE


@pytest.fixture
def running():
    k = kalman.new(VEHICLE, DESIGN)
    f, tuning = k.state[0], k.tuning[0]
    kalman.start(f, tuning, 150.0, 150.0, 150.0, 20.0, 50.0)
    return f, tuning


def sum_known(f, i, value):
    """Let scale and ratio together be known to be ``value``, and nothing of either alone."""
    h = np.zeros(len(f["x"]))
    h[[SCALE, i]] = 1.0
    along = f["P"] @ h
    variance = h @ along + 1e-12
    f["x"][:] += along / variance * (value - h @ f["x"])
    f["P"][:] -= np.outer(along, along) / variance


def test_a_gear_that_was_never_in_may_be_off_by_what_the_file_allows(running):
    f, tuning = running
    gearbox.engage(f, tuning, 0, 3)
    assert f["x"][RATIO_1] == 0.0
    assert f["P"][RATIO_1, RATIO_1] == pytest.approx(DESIGN.ratio_error_share**2)


def test_what_was_learned_of_scale_and_ratio_together_holds_when_the_gear_is_in_again(running):
    f, tuning = running
    gearbox.engage(f, tuning, 0, 3)
    sum_known(f, RATIO_1, 0.02)
    gearbox.engage(f, tuning, 0, 5)
    assert f["x"][RATIO_1] == 0.0  # nothing of another gear
    gearbox.engage(f, tuning, 0, 3)
    assert f["x"][RATIO_1] + f["x"][SCALE] == pytest.approx(0.02, abs=1e-5)
    both = f["P"][RATIO_1, RATIO_1] + 2.0 * f["P"][RATIO_1, SCALE] + f["P"][SCALE, SCALE]
    assert np.sqrt(both) == pytest.approx(float(tuning["ratio_again"]), rel=0.01)
    assert np.sqrt(f["P"][RATIO_1, RATIO_1]) > 0.9 * DESIGN.ratio_error_share  # alone it is as unsure as ever
    assert np.linalg.eigvalsh(f["P"]).min() > -1e-9


def test_a_ratio_follows_the_scale_that_is_learned_meanwhile(running):
    f, tuning = running
    gearbox.engage(f, tuning, 0, 3)
    sum_known(f, RATIO_1, 0.01)
    gearbox.engage(f, tuning, 0, 0)
    f["x"][SCALE] += 0.004
    gearbox.engage(f, tuning, 0, 3)
    assert f["x"][RATIO_1] + f["x"][SCALE] == pytest.approx(0.01, abs=1e-5)


def test_each_shaft_has_its_own(running):
    f, tuning = running
    gearbox.engage(f, tuning, 0, 3)
    gearbox.engage(f, tuning, 1, 2)
    sum_known(f, RATIO_1, 0.02)
    gearbox.engage(f, tuning, 1, 4)
    assert f["x"][RATIO_2] == 0.0
    gearbox.engage(f, tuning, 1, 2)
    assert abs(f["x"][RATIO_2]) < 0.02


def test_neutral_has_no_ratio(running):
    f, tuning = running
    gearbox.engage(f, tuning, 0, 3)
    gearbox.engage(f, tuning, 0, 0)
    assert f["x"][RATIO_1] == 0.0
    assert not f["P"][RATIO_1].any()


def test_what_is_no_number_is_not_kept(running):
    f, tuning = running
    gearbox.engage(f, tuning, 0, 3)
    f["x"][RATIO_1] = np.nan
    ratios.remember(f, 0)
    assert not f["ratio_known"].any()


def test_of_a_state_that_was_no_number_nothing_is_kept():
    k = kalman.new(VEHICLE, DESIGN)
    f, tuning = k.state[0], k.tuning[0]
    kalman.start(f, tuning, 150.0, 150.0, 150.0, 20.0, 50.0)
    gearbox.engage(f, tuning, 0, 3)
    f["x"][:] = np.nan
    gearbox.engage(f, tuning, 0, 5)
    frame.start(k, np.zeros(1, ANSWER)[0])
    assert not f["ratio_known"].any()
    gearbox.engage(f, tuning, 0, 3)
    assert f["P"][RATIO_1, RATIO_1] == pytest.approx(DESIGN.ratio_error_share**2)


def test_a_new_start_keeps_what_is_plainly_wrong(running):
    """A ratio by 2 % and a delay of 40 ms; not the ratio that is as right as the file allows."""
    f, tuning = running
    gearbox.engage(f, tuning, 0, 3)
    gearbox.engage(f, tuning, 1, 2)
    sum_known(f, RATIO_1, 0.02)
    f["x"][RATIO_2], f["x"][LATE], f["P"][LATE, LATE] = 0.001, 0.04, 1e-6
    gearbox.engage(f, tuning, 0, 0)
    gearbox.engage(f, tuning, 1, 0)
    kalman.start(f, tuning, 150.0, 150.0, 150.0, 20.0, 50.0)
    assert list(np.flatnonzero(f["ratio_known"])) == [4]
    assert (f["x"][LATE], f["P"][LATE, LATE]) == (0.04, 1e-6)
    gearbox.engage(f, tuning, 0, 3)
    assert f["x"][RATIO_1] + f["x"][SCALE] == pytest.approx(0.02, rel=0.05)
    f["x"][LATE] = 0.01
    kalman.start(f, tuning, 150.0, 150.0, 150.0, 20.0, 50.0)
    assert (f["x"][LATE], f["P"][LATE, LATE]) == (0.0, DESIGN.delay_error_s**2)


def health_of(f):
    row = np.zeros(1, HEALTH)
    ratios.report(f, row[0])
    return row[0]


def test_of_one_gear_all_is_told_of_the_wheels(running):
    f, tuning = running
    gearbox.engage(f, tuning, 0, 3)
    f["x"][SCALE], f["x"][RATIO_1] = 0.001, -0.002
    health = health_of(f)
    assert health["wheel_scale_error"] == pytest.approx(0.003)
    assert health["wheel_scale_sigma"] > DESIGN.wheel_scale_error_share
    assert not health["gear_ratio_error"].any()


def test_health_tells_the_odd_gear_against_the_others(running):
    """Wheels and two gears are off by 0.3 % alike, which no speed shows; the third is 2 % off beside."""
    f, tuning = running
    f["x"][SCALE] = 0.003
    for gear, error in ((1, 0.003), (3, 0.023), (5, 0.003)):
        gearbox.engage(f, tuning, 0, gear)
        f["x"][RATIO_1] = error
    health = health_of(f)
    assert health["wheel_scale_error"] == pytest.approx(0.0, abs=1e-12)
    assert health["gear_ratio_error"][[2, 4, 6]] == pytest.approx([0.0, 0.02, 0.0], abs=1e-12)
    assert (health["gear_ratio_sigma"] > 0.0).sum() == 3
    assert health["gear_ratio_sigma"][3] == 0.0  # never in
