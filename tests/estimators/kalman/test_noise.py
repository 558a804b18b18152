"""How much the driveline may do until the next frame, by phase, brakes, synchronisers and what just happened."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman import gearbox
from dctorque_can.estimators.kalman import noise as kalman_noise
from dctorque_can.estimators.kalman.model import State
from dctorque_can.estimators.kalman.tuning import tuning as tuning_of
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
VEHICLE, DESIGN = SETTINGS.vehicle, SETTINGS.kalman
TABLES = kalman.new(VEHICLE, DESIGN).tables
OPEN, SLIPPING, LOCKED = 0, 1, 2


def new_filter(**changes):
    """A filter in first and second gear, started at 200, 150, 100 and 10 rad/s."""
    k = kalman.Kalman(np.zeros(1, kalman.FILTER), tuning_of(VEHICLE, replace(DESIGN, **changes)), TABLES)
    f = k.state[0]
    f["gear"][:] = 1, 2
    kalman.start(f, k.tuning[0], 200.0, 150.0, 100.0, 10.0, 80.0)
    return k


def test_wrong_parameters_spread_what_they_falsify():
    """A twist that jumps by 0.1 rad with a stiffness that may be 20 % off is in the end uncertain by 0.02 rad."""
    k = new_filter(parameter_error_share=0.2, timing_error_s=0.0)
    f = k.state[0]
    f["x"][State.TH_O] = 0.1
    before = f["P"][State.TH_O, State.TH_O]
    for _ in range(3000):
        kalman_noise.admit_parameter_errors(f, k.tuning[0], 0.001)
    assert np.sqrt(f["P"][State.TH_O, State.TH_O] - before) == pytest.approx(0.02, rel=0.01)


def test_a_torque_is_lively_after_an_event_and_then_steady():
    """1500 N·m/s while it slides, 2500 near lock-up, e⁻¹ of that 0.2 s after it has locked, in the end 50."""
    k = new_filter()
    f = k.state[0]
    f["torque_rate"][1] = 0.0
    rates = []
    for engine, phase, seconds in (
        (163.0, SLIPPING, 0.01),
        (161.0, SLIPPING, 0.01),
        (150.0, LOCKED, 0.2),
        (150.0, LOCKED, 10.0),
    ):
        f["x"][State.W_E] = engine  # the shaft has 150 rad/s
        kalman_noise.decide_rates(f, k.tuning[0], phase, OPEN, seconds)
        rates.append(f["torque_rate"][0])
    assert rates == pytest.approx([1500.0, 2500.0, 2500.0 / np.e, 50.0])


@pytest.mark.parametrize(("shaft_2", "rate"), [(170.0, 1500.0), (190.0, 2500.0)])
def test_a_locked_clutch_changes_as_the_other_one_does(shaft_2, rate):
    """Clutch 1 is locked, clutch 2 slips: while that one slides by 30 rad/s neither torque jumps."""
    k = new_filter()
    f = k.state[0]
    f["x"][State.W_E], f["x"][State.W_C2] = 200.0, shaft_2
    f["torque_rate"][:] = 0.0
    kalman_noise.decide_rates(f, k.tuning[0], LOCKED, SLIPPING, 0.01)
    assert f["torque_rate"].tolist() == [rate, rate]


def test_a_synchroniser_shakes_the_locked_clutch():
    """4 N·m that turn shaft 1 swing clutch 2 through both ratios within 40 ms; the most is 800 N·m/s."""
    k = new_filter()
    f, tuning = k.state[0], k.tuning[0]
    gearbox.change_gears(f, tuning, 0, 2)
    assert f["torque_rate"][1] >= 800.0  # it is about to pull
    f["torque_rate"][1] = 0.0
    rates = []
    for torque in (0.0, -4.0, 100.0):
        f["x"][State.T_C1] = torque
        kalman_noise.decide_rates(f, tuning, OPEN, LOCKED, 10.0)
        rates.append(f["torque_rate"][1])
    ratio = np.mean([VEHICLE.gear(number).total_ratio for number in (1, 3, 5)]) / VEHICLE.gear(2).total_ratio
    assert rates == pytest.approx([50.0, 4.0 * ratio / 0.04, 800.0])


def test_brakes_that_stay_as_they_are_are_steady():
    """3000 N·m/√s as they come, as the car stops and as they go, else a fifth; a load that jumps: they change."""
    k = new_filter()
    f, tuning = k.state[0], k.tuning[0]
    rates = []
    for brakes, stands, seconds, load in (
        (True, False, 0.01, 0.0),
        (True, False, 0.2, 0.0),
        (True, False, 10.0, 0.0),
        (True, False, 0.01, 1000.0),
        (True, False, 10.0, 1000.0),  # since when it has changed no more
        (True, False, 10.0, 1000.0),
        (True, True, 0.01, 1000.0),
        (False, True, 0.01, 1000.0),
        (False, True, 10.0, 1000.0),
        (False, False, 0.01, 1000.0),
        (False, False, 10.0, 1000.0),
        (False, False, 0.01, 3000.0),  # a hill
    ):
        f["x"][State.T_V] = load
        kalman_noise.decide_brake_rate(f, tuning, brakes, stands, seconds)
        rates.append(f["brake_rate"])
    changed = 1000.0 / np.sqrt(0.2)
    most, steady = 3000.0, 600.0
    expected = [most, most / np.e, steady, changed, 0.95 * changed, steady, most, most, steady, most, 0.0, 0.0]
    assert rates == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("brakes", "stands", "tyre"),
    [(True, False, 300.0), (True, True, 300.0), (False, True, 15.0), (False, False, 300.0)],
)
def test_half_of_the_brakes_is_at_the_driven_wheels(brakes, stands, tyre):
    """A car that stands without them may hang in its gears; after they were let go they act for a while."""
    k = new_filter()
    f, tuning = k.state[0], k.tuning[0]
    f["x"][[State.R_1, State.R_2]] = f["torque_rate"][:] = 0.0
    f["brakes"], f["stands"], f["brake_rate"] = brakes, stands, 600.0
    noises = kalman_noise.process_noise(f, tuning, LOCKED, OPEN)
    assert noises[2:4] == pytest.approx((tyre**2, 600.0**2))
    f["brake_rate"] = 0.0
    assert kalman_noise.process_noise(f, tuning, LOCKED, OPEN)[2:4] == pytest.approx((15.0**2, 60.0**2))


def test_tyres_that_hand_on_more_slip_more():
    """A clutch torque that grows by 2000 N·m/s makes 15 % of that uncertain at the wheel."""
    k = new_filter()
    f, ratio = k.state[0], VEHICLE.gear(1).total_ratio
    f["torque_rate"][:] = 1500.0
    tyres = []
    for rate in (100.0, 2000.0):
        f["x"][[State.R_1, State.R_2]] = rate, 0.0
        tyres.append(kalman_noise.process_noise(f, k.tuning[0], SLIPPING, OPEN)[2] - 15.0**2)
    own = np.array([DESIGN.tyre_torque_share * ratio * 1500.0, 0.15 * ratio * 2000.0])
    assert tyres == pytest.approx(2.0 * DESIGN.torque_rate_time_s * own**2)
