"""Power, energy, residual and temperature on drives by formula: 60 N·m at 40 rad/s of slip are 2400 W."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.driveline.parameters import Thermal
from dctorque_can.estimators.methods import Method
from dctorque_can.estimators.oh2014.design import SubObserver
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Input

from .drives import SETTINGS, VALID, VEHICLE, Q, S, at, cruise, estimates, known, traffic, with_design

POWER_W = 2400.0
LAG_S = 1.0 / SETTINGS.observer.torque_crossover_rad_s  # of the torque behind a clutch that closes at once
THERMAL = Thermal(heat_capacity_j_per_k=500.0, cooling_w_per_k=50.0, coolant_c=80.0)
TIME_S = THERMAL.heat_capacity_j_per_k / THERMAL.cooling_w_per_k
WARM = replace(
    SETTINGS,
    vehicle=replace(VEHICLE, clutches=(replace(VEHICLE.clutches[0], thermal=THERMAL), VEHICLE.clutches[1])),
)
COMMANDED = replace(
    SETTINGS,
    inputs=(
        *SETTINGS.inputs,
        *(Input(q, (), -100.0, 500.0, 100_000) for q in (Q.CLUTCH1_COMMAND, Q.CLUTCH2_COMMAND)),
    ),
)
KNOWN_ENERGY = {1: S.ENERGY1_KNOWN, 2: S.ENERGY2_KNOWN}
KNOWN_RESIDUAL = {1: S.RESIDUAL1_KNOWN, 2: S.RESIDUAL2_KNOWN}


def closed_between(*times, clutch=1, **changes):
    """Values of a drive whose one clutch is closed between pairs of times, the other open."""

    def values(t):
        closed = any(a <= t < b for a, b in zip(times[::2], times[1::2], strict=True))
        positions = {Q.CLUTCH1_POSITION: 0.0, Q.CLUTCH2_POSITION: 0.0}
        positions[Q.CLUTCH1_POSITION if clutch == 1 else Q.CLUTCH2_POSITION] = 10.0 * closed
        return cruise(**changes) | positions

    return values


def ledger(rows, clutch):
    """Energy of each row from the powers of the rows alone, which are those of all frames."""
    power, number = rows[f"clutch{clutch}_power_w"], rows[f"clutch{clutch}_engagements"]
    energy, dt = np.zeros(len(rows)), np.diff(rows["t_us"]) * 1e-6
    on = False
    for k in range(1, len(rows)):
        begins = number[k] != number[k - 1]
        energy[k] = 0.0 if begins else energy[k - 1]
        if begins or on:
            energy[k] += 0.5 * (power[k - 1] + power[k]) * dt[k - 1]
        on = (begins or on) and rows[f"phase{clutch}"][k] == 1
    return energy


@pytest.mark.parametrize("clutch", [1, 2])
def test_power_and_energy_of_engagements(clutch):
    """Two engagements of 0.5 and 0.3 s: 2400 W for so long, less the lag; held in between, counted from zero."""
    wheel = 20.0 if clutch == 1 else 30.0  # so that the engine is faster than the shaft that slips
    slip = 40.0 if clutch == 1 else wheel * 8.066 + 40.0 - wheel * 13.986
    rows = estimates(
        SETTINGS, 2.0, closed_between(0.505, 1.005, 1.305, 1.605, clutch=clutch, wheel=wheel, slip=slip)
    )
    assert rows[f"clutch{clutch}_slip_rad_s"][-1] == pytest.approx(40.0, abs=0.01)
    energy, power = rows[f"clutch{clutch}_energy_j"], rows[f"clutch{clutch}_power_w"]
    assert at(rows, 900)[f"clutch{clutch}_power_w"] == pytest.approx(POWER_W, rel=0.005)
    assert at(rows, 1100)[f"clutch{clutch}_energy_j"] == pytest.approx((0.5 - LAG_S) * POWER_W, rel=0.01)
    assert at(rows, 1900)[f"clutch{clutch}_energy_j"] == pytest.approx((0.3 - LAG_S) * POWER_W, rel=0.01)
    assert rows[f"clutch{clutch}_heat_j"][-1] == pytest.approx((0.8 - 2 * LAG_S) * POWER_W, rel=0.01)
    np.testing.assert_allclose(energy, ledger(rows, clutch), rtol=1e-12)
    assert [int(at(rows, ms)[f"clutch{clutch}_engagements"]) for ms in (400, 900, 1100, 1400, 1900)] == [
        0,
        1,
        1,
        2,
        2,
    ]
    assert (power[rows[f"phase{clutch}"] == 0] == 0.0).all()
    held = rows[(rows["t_us"] > 1_010_000) & (rows["t_us"] < 1_300_000)]
    assert len(set(held[f"clutch{clutch}_energy_j"])) == 1
    assert (rows["status"][rows["t_us"] > 510_000] & KNOWN_ENERGY[clutch]).all()
    assert not (rows["status"][rows["t_us"] < 500_000] & KNOWN_ENERGY[clutch]).any()
    for name in ("power_w", "energy_j", "heat_j", "engagements"):
        assert not rows[f"clutch{3 - clutch}_{name}"].any()


def test_friction_heats_whatever_its_direction():
    """Coasting, the shaft drives the engine: torque and slip are negative, the power is not."""
    row = at(estimates(SETTINGS, 1.0, closed_between(0.3, 9.0, torque=-60.0, slip=-40.0)), 900)
    assert row["clutch1_torque_nm"] < 0.0 > row["clutch1_slip_rad_s"]
    assert row["clutch1_power_w"] == pytest.approx(POWER_W, rel=0.005)


def test_locking_ends_an_engagement_and_slipping_again_begins_none():
    """Slip fades from 40 rad/s and the clutch locks; later it slips again: that heats, and is no engagement."""

    def values(t):
        slip = float(np.interp(t, [0.6, 1.0, 1.4, 1.6], [40.0, 0.0, 0.0, 20.0]))
        return cruise(60.0, slip) | {Q.CLUTCH1_POSITION: 10.0 * (t >= 0.3)}

    rows = estimates(SETTINGS, 2.0, values)
    assert (rows["clutch1_power_w"][rows["phase1"] == 2] == 0.0).all()
    locked, end = at(rows, 1300), rows[-1]
    assert (locked["phase1"], end["phase1"]) == (2, 1)
    inertia = VEHICLE.engine_inertia_kgm2 + VEHICLE.damper.inertia_kgm2  # brakes at 100 rad/s²
    expected = (0.3 - LAG_S) * POWER_W + 0.4 * 20.0 * (60.0 + 100.0 * inertia)
    assert (
        locked["clutch1_energy_j"] == locked["clutch1_heat_j"] == pytest.approx(expected, rel=0.03)
    )  # the ramp's own lag
    assert end["clutch1_energy_j"] == locked["clutch1_energy_j"]
    assert end["clutch1_heat_j"] > locked["clutch1_heat_j"] + 300.0
    assert (locked["clutch1_engagements"], end["clutch1_engagements"]) == (1, 1)
    assert end["status"] & S.ENERGY1_KNOWN


def test_neutral_has_no_friction():
    """A closed clutch whose shaft is in neutral turns that shaft alone; it engages when a gear goes in."""
    rows = estimates(SETTINGS, 1.0, lambda t: cruise() | {Q.GEAR1: 0 if t < 0.5 else 1})
    assert not rows["clutch1_power_w"][rows["t_us"] < 500_000].any()
    assert rows["clutch1_engagements"][-1] == 1
    assert rows["clutch1_power_w"][-1] == pytest.approx(POWER_W, rel=0.01)


def test_an_engagement_that_was_under_way_is_not_known():
    """Closed from the start: power and heat, but no energy of an engagement."""
    rows = estimates(SETTINGS, 1.0, lambda t: cruise())
    assert rows["clutch1_power_w"][-1] == pytest.approx(POWER_W, rel=0.005)
    assert rows["clutch1_heat_j"][-1] > 2000.0
    assert not rows["clutch1_energy_j"].any()
    assert not rows["clutch1_engagements"].any()
    assert not (rows["status"] & S.ENERGY1_KNOWN).any()


@pytest.mark.parametrize(
    "lost",
    [
        {Q.CLUTCH1_POSITION: None},  # it may be open
        {Q.ENGINE_TORQUE: None},  # nothing is estimated
        {Q.CLUTCH2_POSITION: 6.0, Q.BRAKE: 1.0},  # the torques are not valid
    ],
)
def test_an_engagement_with_a_gap_is_not_known(lost):
    """What happens between 0.6 and 0.9 s spoils the first engagement and not the next."""
    whole = closed_between(0.3, 1.2, 1.6, 9.0)
    rows = estimates(SETTINGS, 2.0, lambda t: whole(t) | {Q.BRAKE: 0.0} | (lost if 0.6 < t < 0.9 else {}))
    known = (rows["status"] & S.ENERGY1_KNOWN) > 0
    assert known[(rows["t_us"] > 310_000) & (rows["t_us"] < 600_000)].all()
    assert not known[(rows["t_us"] > 750_000) & (rows["t_us"] < 1_600_000)].any()
    assert known[rows["t_us"] > 1_620_000].all()
    assert rows["clutch1_engagements"][-1] == 2


@pytest.mark.parametrize("pause_s", [2.0, -3600.0])
def test_a_gap_in_the_traffic_adds_nothing(pause_s):
    """No work is done while nothing is known, however long; what was counted stays."""
    estimator = Estimator(SETTINGS)
    before = estimator.feed(traffic(1.0, closed_between(0.3, 9.0))).rows[-1]
    rows = estimator.feed(traffic(0.5, closed_between(0.0, 9.0), 1_000_000 + round(pause_s * 1e6))).rows
    for name in ("clutch1_heat_j", "clutch1_energy_j", "clutch1_engagements"):
        assert rows[name][0] == before[name]
    assert rows["clutch1_heat_j"][-1] == pytest.approx(before["clutch1_heat_j"] + 0.49 * POWER_W, rel=0.03)
    assert not (rows["status"] & S.ENERGY1_KNOWN).any()
    assert rows["clutch1_engagements"][-1] == 1


def test_the_adaptive_torque_alone_gives_no_power():
    """It knows nothing of the clutches."""
    rows = estimates(with_design(sub_observer=SubObserver.ADAPTIVE), 1.0, closed_between(0.3, 9.0))
    assert not rows["clutch1_power_w"].any()
    assert not (rows["status"] & S.ENERGY1_KNOWN).any()


def test_the_temperature_of_a_steady_power():
    """θ = θ_c + P/h (1 − exp(−h t/C)) while it slips, then back by exp(−h t/C)."""
    rows = estimates(WARM, 4.0, closed_between(0.5, 3.0))
    theta, t = rows["clutch1_temperature_c"], rows["t_us"] * 1e-6
    assert theta[0] == 80.0
    slipping = (rows["phase1"] == 1) & (t > 0.4)
    since = t[slipping] - t[slipping][0]
    expected = 80.0 + POWER_W / 50.0 * -np.expm1(-np.maximum(since - LAG_S, 0.0) / TIME_S)
    np.testing.assert_allclose(theta[slipping], expected, atol=0.04)
    cooling = (rows["phase1"] == 0) & (t > 3.1)
    decay = (theta[cooling] - 80.0) / (theta[cooling][0] - 80.0)
    np.testing.assert_allclose(decay, np.exp(-(t[cooling] - t[cooling][0]) / TIME_S), rtol=1e-12)
    assert (rows["status"][t > 0.01] & S.TEMPERATURE1_KNOWN).all()
    assert not (rows["status"] & S.TEMPERATURE2_KNOWN).any()
    assert not rows["clutch2_temperature_c"].any()


def test_the_temperature_of_any_power():
    """Against the sum of the answers to each interval's work: C (θ − θ_c) = Σ work · decay."""

    def values(t):
        return cruise(60.0 + 30.0 * math.sin(9.0 * t), 40.0 + 20.0 * math.sin(5.0 * t))

    rows = estimates(WARM, 3.0, values)
    t, theta = rows["t_us"] * 1e-6, rows["clutch1_temperature_c"]
    work = np.diff(rows["clutch1_heat_j"], prepend=0.0)
    middle = np.concatenate([[0.0], 0.5 * (t[1:] + t[:-1])])
    expected = 80.0 + np.sum(work * np.exp(-(t[-1] - middle) / TIME_S)) / THERMAL.heat_capacity_j_per_k
    assert theta[-1] > 90.0
    assert theta[-1] == pytest.approx(expected, rel=1e-6)


def test_a_clutch_cools_over_a_pause():
    """12 s without a frame: no power is known, and the coolant goes on cooling."""
    estimator = Estimator(WARM)
    before = estimator.feed(traffic(2.0, closed_between(0.3, 9.0))).rows[-1]
    after = estimator.feed(traffic(0.01, closed_between(), 14_000_000)).rows[0]
    passed = (after["t_us"] - before["t_us"]) * 1e-6
    cooled = 80.0 + (before["clutch1_temperature_c"] - 80.0) * math.exp(-passed / TIME_S)
    assert after["clutch1_temperature_c"] == pytest.approx(cooled, rel=1e-12)
    assert not after["status"] & S.TEMPERATURE1_KNOWN  # its inputs are not back yet


@pytest.mark.parametrize(
    ("torque", "slip", "command", "residual"),
    [(60.0, 40.0, 55.0, 5.0), (60.0, 40.0, 70.0, -10.0), (-60.0, -40.0, 55.0, -5.0), (60.0, 40.0, -20.0, 60.0)],
)
def test_the_residual_of_a_slipping_clutch(torque, slip, command, residual):
    """The command is a capacity: it acts along the slip. A negative one holds the clutch open."""
    rows = estimates(
        COMMANDED, 1.0, lambda t: cruise(torque, slip) | {Q.CLUTCH1_COMMAND: command, Q.CLUTCH2_COMMAND: 30.0}
    )
    assert rows["clutch1_residual_nm"][-1] == pytest.approx(residual, abs=0.3)
    assert rows["status"][-1] & (VALID | S.RESIDUAL1_KNOWN | S.RESIDUAL2_KNOWN) == VALID | S.RESIDUAL1_KNOWN
    assert rows["clutch2_residual_nm"][-1] == 0.0  # open


@pytest.mark.parametrize(
    "why",
    [
        {Q.CLUTCH1_POSITION: 0.0},  # open
        {Q.CLUTCH1_POSITION: None},  # perhaps open
        {Q.CLUTCH1_COMMAND: None},  # stale
        {Q.ENGINE_SPEED: cruise(slip=0.0)[Q.ENGINE_SPEED]},  # locked
        {Q.GEAR1: 0},
    ],
)
def test_a_clutch_that_need_not_follow_its_command(why):
    """Open or locked clutches transmit less than their command; without a fresh one nothing can be compared."""
    rows = estimates(COMMANDED, 1.2, lambda t: cruise() | {Q.CLUTCH1_COMMAND: 55.0} | (why if t > 0.7 else {}))
    assert at(rows, 600)["status"] & S.RESIDUAL1_KNOWN
    assert not rows["status"][-1] & S.RESIDUAL1_KNOWN
    assert rows["clutch1_residual_nm"][-1] == 0.0


def test_without_a_command_there_is_no_residual():
    rows = estimates(SETTINGS, 0.5, lambda t: cruise())
    assert not (rows["status"] & (S.RESIDUAL1_KNOWN | S.RESIDUAL2_KNOWN)).any()
    assert not rows["clutch1_residual_nm"].any()


@pytest.mark.parametrize("method", [Method.OH2014, Method.KALMAN])
def test_wild_measurements_stay_finite(method):
    """Speeds, torques and commands anywhere within their ranges, with every quantity configured."""
    both = replace(
        WARM,
        inputs=COMMANDED.inputs,
        method=method,
        vehicle=replace(WARM.vehicle, clutches=(WARM.vehicle.clutches[0],) * 2),
    )
    random = np.random.default_rng(5)
    data = traffic(
        1.0, lambda t: cruise() | {Q.CLUTCH2_POSITION: 6.0, Q.CLUTCH1_COMMAND: 1.0, Q.CLUTCH2_COMMAND: 1.0}
    )
    wild = (data.quantity < 8) | (data.quantity >= Q.CLUTCH1_COMMAND)
    value = np.where(
        wild & (random.random(len(data)) < 0.3), random.uniform(-1500.0, 1500.0, len(data)), data.value
    )
    rows = Estimator(both).feed(replace(data, value=value)).rows
    assert len(rows) > 100
    for name in known(both.method):
        assert np.isfinite(rows[name].astype(float)).all(), name
    assert (rows["tie_up_probability"] >= 0.0).all()
    assert (rows["tie_up_probability"] <= 1.0).all()
    assert (np.diff(rows["clutch1_heat_j"]) >= 0.0).all()
