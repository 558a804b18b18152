"""The sampled form against the printed continuous system, and its rules against hand-made numbers."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.estimators.oh2014 import model as oh2014_model
from dctorque_can.estimators.oh2014 import observer as oh2014
from dctorque_can.estimators.oh2014.design import RoadLoad
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
VEHICLE = SETTINGS.vehicle
R = {gear.number: gear.total_ratio for gear in VEHICLE.gears}
EFFICIENCY = VEHICLE.gear_efficiency * VEHICLE.final_drive_efficiency
FOREVER = 1e6  # s: any averaging has ended


def observer(g1=1, g2=2, lossless=False, **design):
    vehicle = replace(VEHICLE, gear_efficiency=1.0, final_drive_efficiency=1.0) if lossless else VEHICLE
    constants = oh2014_model.constants(vehicle, replace(SETTINGS.observer, **design))
    pair = np.zeros(1, oh2014_model.PAIR)
    oh2014_model.set_pair(pair[0], constants[0], g1, g2)
    return constants[0], pair[0]


def state(**values):
    record = np.zeros(1, oh2014.STATE)
    for name, value in values.items():
        record[name] = value
    return record


NAMES = ("T_c1", "T_c2", "tau_e", "tau_o", "w_e", "T_c", "w_s", "T_a")


def sampled_rates(c, pair, x, point, h):
    """Return the mean rate of all eight states over one step and one sample of every speed."""
    w_e, w_c1, w_c2, a_w, T_en = point
    record = state(**dict(zip(NAMES, x, strict=True)), a_w=a_w)
    s = record[0]
    oh2014.predict(s, c, pair, T_en, h)
    oh2014.correct_engine(s, c, pair, True, True, w_e, h)
    oh2014.correct_shaft(s, c, pair, True, True, w_c1, h)
    dT_c1, dT_c2 = oh2014.shaft_torque_rates(c, pair, True, True, w_c1, w_c2, 0.0)
    oh2014.add_shaft_torques(s, (h * dT_c1, h * dT_c2))
    oh2014.settle(s, c, pair, True, True, h)
    return (np.array([record[name][0] for name in NAMES]) - x) / h


@pytest.mark.parametrize("printed", [True, False])
@pytest.mark.parametrize("a_w", [20.0, -15.0])
@pytest.mark.parametrize(("g1", "g2"), [(1, 2), (3, 4)])
def test_short_samples_give_the_printed_system(printed, a_w, g1, g2):
    """(x(h) - x)/h of predict and correct tends to (68) in all eight states: 2 r(h/2) - r(h) agrees to 5e-3."""
    gains = {"engine_bandwidth_rad_s": 200.0, "shaft_bandwidth_rad_s": 200.0, "torque_crossover_rad_s": 250.0}
    c, pair = observer(g1, g2, lossless=True, printed_rate_law=printed, road_load=RoadLoad.NONE, **gains)
    # clutch torques near (65), (66) and shafts almost without twist, so that no term of (37), (38) hides another
    x = np.array([20.1, 69.8, 0.1, 150.0, 198.0, 90.0, 183.0, 20.0 + R[g2] / R[g1] * 70.0])
    point = (200.0, 180.0, 180.0 * R[g2] / R[g1] + 0.003, a_w, 100.0)
    expected = oh2014.right_hand_side(x, c, pair, *point)
    coarse, fine = (sampled_rates(c, pair, x, point, h) for h in (1e-6, 5e-7))
    np.testing.assert_allclose(2.0 * fine - coarse, expected, rtol=5e-3)


def test_the_rate_laws_are_apart_in_the_sampled_form():
    """Printed: an engine innovation moves both clutch torques by k ε_e; otherwise it moves neither."""
    x = np.array([10.0, 20.0, 0.1, 150.0, 198.0, 90.0, 180.0, 80.0])
    point = (200.0, 180.0, 250.0, 6.0, 100.0)
    rates = [sampled_rates(*observer(printed_rate_law=printed), x, point, 1e-5) for printed in (True, False)]
    difference = rates[0] - rates[1]
    c, pair = observer()
    eps_e = 2.0 * c["p_e"] * c["J_e"] * (200.0 - 198.0)
    dT_o = -pair["g_t"] * 6.0**2 / R[1] * eps_e  # at the wheel; less on the clutches by their ratios
    assert R[1] * difference[0] + R[2] * difference[1] == pytest.approx(dT_o, rel=0.02)
    np.testing.assert_allclose(difference[2:], 0.0, atol=1e-9)


@pytest.mark.parametrize("h", [0.001, 0.02, 0.25])
def test_shaft_and_wheel_filters_have_the_designed_poles(h):
    """The errors of (ω_s, T_a) and (ω_w, a_w) over one predict and correct have both eigenvalues exp(-p h)."""
    c, pair = observer(road_load=RoadLoad.NONE)
    for speed, rate, p in (("w_s", "T_a", c["p_s"]), ("w_w", "a_w", pair["p_w"])):
        columns = []
        for start in ((1e-3, 0.0), (0.0, 1e-3)):
            record = state(**{speed: start[0], rate: start[1]})
            oh2014.predict(record[0], c, pair, 0.0, h)
            if speed == "w_s":
                oh2014.correct_shaft(record[0], c, pair, True, True, 0.0, h)
            else:
                oh2014.correct_wheel(record[0], pair, 0.0, h)
            columns.append([record[speed][0] * 1e3, record[rate][0] * 1e3])
        matrix = np.array(columns).T
        z = np.exp(-p * h)
        assert np.trace(matrix) == pytest.approx(2 * z, abs=1e-9)
        assert np.linalg.det(matrix) == pytest.approx(z * z, abs=1e-9)


def test_the_acceleration_filter_balances_lag_and_noise_for_every_pair():
    """Lag ∝ 1/p and noise ∝ p^1.5/|R_1 - R_2| keep their ratio from pair to pair; neutral separates nothing."""
    ratios = []
    for g1, g2 in ((1, 2), (3, 2), (3, 4), (5, 4)):
        c, pair = observer(g1, g2)
        ratios.append(float(pair["p_w"] ** 2.5 / abs(R[g1] - R[g2])))
    assert ratios == pytest.approx([ratios[0]] * 4)
    assert observer(1, 2)[1]["p_w"] == observer(1, 0)[1]["p_w"] == c["p_w"]


@pytest.mark.parametrize(
    ("g1", "g2", "side", "T_a", "w_s"),
    [
        (1, 2, 1, 40.0 + R[2] / R[1] * 70.0, 300.0),  # (61)
        (1, 0, 1, 40.0, 300.0),
        (0, 2, 2, 70.0, 150.0),
        (0, 0, 0, 0.0, 99.0),
    ],
)
def test_new_gears_keep_the_torques(g1, g2, side, T_a, w_s):
    """The clutch-side observer goes to the shaft that is in gear, at its speed, with the torque it stands for."""
    c, pair = observer(5, 4)
    record = state(T_c1=40.0, T_c2=70.0, w_s=99.0, T_a=-5.0)
    oh2014.change_gears(record[0], c, pair, g1, g2, 300.0, 150.0)
    assert pair["side"] == side
    assert record["T_a"][0] == pytest.approx(T_a)
    assert record["w_s"][0] == w_s


@pytest.mark.parametrize(
    ("T_o", "R_s", "factor"),
    [
        (300.0, 14.0, 1 / EFFICIENCY),  # drives
        (-300.0, 14.0, EFFICIENCY),  # coasts
        (-300.0, -14.0, 1 / EFFICIENCY),  # drives in reverse
        (300.0, -14.0, EFFICIENCY),  # coasts in reverse
    ],
)
def test_losses_follow_the_power(T_o, R_s, factor):
    """Power is lost where it flows to: less at the wheels when driving, less at the shaft when coasting."""
    c, pair = observer()
    pair["R_s"] = R_s
    assert oh2014.loss_factor(c, pair, T_o) == pytest.approx(factor)
    assert oh2014.after_losses(c, pair, T_o) == pytest.approx(T_o / factor)


@pytest.mark.parametrize(("g1", "g2"), [(1, 2), (0, 2), (3, 2)])
@pytest.mark.parametrize("T_c", [60.0, -60.0])
def test_learned_load_balances_the_clutch_that_carries(g1, g2, T_c):
    """In the end the road load is η^±1 R_own T_c, or nothing with both open; with both closed it is held."""
    c, pair = observer(g1, g2)
    sign = np.copysign(1.0, T_c)
    eta = EFFICIENCY**sign
    for carries, gear in (((True, False), g1), ((False, True), g2), ((False, False), 0), ((True, True), None)):
        if carries[0] and g1 == 0:
            continue
        T_n = 100.0 * sign
        T_a = T_n / eta / pair["R_s"]  # what the clutch-side observer finds for this load
        record = state(T_n=T_n, T_a=T_a, T_c=T_c, w_w=20.0)
        learned = oh2014.learn_road_load(record[0], c, pair, *carries, FOREVER)
        assert learned == (gear is not None)
        expected = T_n if gear is None else eta * R.get(gear, 0.0) * T_c
        assert record["T_n"][0] == pytest.approx(expected, abs=1e-9)


def test_no_load_is_learned_at_rest_or_in_neutral():
    """The wheel turns at 0.2 rad/s, or no gear is in: T_n stays."""
    for gears, w_w in (((1, 2), 0.2), ((1, 2), -0.2), ((0, 0), 20.0)):
        c, pair = observer(*gears)
        record = state(T_n=100.0, T_c=60.0, w_w=w_w)
        assert not oh2014.learn_road_load(record[0], c, pair, True, False, FOREVER)
        assert record["T_n"][0] == 100.0


@pytest.mark.parametrize("road_load", list(RoadLoad))
def test_road_load_at_the_start(road_load):
    """The literal paper knows none; otherwise the start is the flat road's, which FLAT follows with the speed."""
    c, pair = observer(road_load=road_load)
    chassis = VEHICLE.chassis
    flat = [
        chassis.wheel_radius_m
        * (
            chassis.rolling_resistance * chassis.mass_kg * 9.80665
            + 0.6 * (w * chassis.wheel_radius_m) ** 2 * chassis.drag_coefficient * chassis.frontal_area_m2
        )
        for w in (50.0, 80.0)
    ]
    record = state()
    oh2014.reset(record[0], c, 200.0, 180.0, 50.0, 77.0)
    assert record["T_n"][0] == pytest.approx(0.0 if road_load is RoadLoad.NONE else flat[0])
    assert record["T_c"][0] == 77.0
    record["w_w"] = 80.0
    assert not oh2014.learn_road_load(record[0], c, pair, True, True, FOREVER)
    assert record["T_n"][0] == pytest.approx([0.0, flat[1], flat[0]][road_load])


def test_open_clutches_carry_nothing():
    """With one clutch open the other carries T_c whatever T_a says; with both open nothing is carried."""
    c, pair = observer()
    for carries, expected in (
        ((True, False), (90.0, 0.0)),
        ((False, True), (0.0, 90.0)),
        ((False, False), (0, 0)),
    ):
        record = state(T_c1=5.0, T_c2=6.0, T_c=90.0, T_a=-300.0)
        oh2014.settle(record[0], c, pair, *carries, FOREVER)
        assert (record["T_c1"][0], record["T_c2"][0]) == pytest.approx(expected)
        assert (record["T_c1_uio"][0], record["T_c2_uio"][0]) == pytest.approx(expected)
