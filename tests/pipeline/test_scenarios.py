"""Drives whose torques, gears and phases follow from a formula by hand."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.estimators.oh2014.design import RoadLoad, SubObserver
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import SampleStatus
from dctorque_can.pipeline.settings import GearInference

from .drives import (
    EFFICIENCY,
    LEARNED,
    READY,
    SETTINGS,
    VALID,
    VEHICLE,
    WHEELS,
    Q,
    R,
    S,
    at,
    cruise,
    estimates,
    rolling,
    samples,
    timeline,
    traffic,
    with_design,
)

LITERAL = with_design(road_load=RoadLoad.NONE)
SLOW = {"torque_crossover_rad_s": 0.5}  # lets the transfer shaft model stand alone for a while
OPEN, SLIPPING, LOCKED = 0, 1, 2


def pulse(t):
    """Both clutches carry, and shaft 1 runs 0.5 rad/s faster for ten frames."""
    now = cruise() | {Q.CLUTCH2_POSITION: 6.0}
    now[Q.SHAFT1_SPEED] += 0.5 * (1.0 < t < 1.1)
    return now


def test_twist_moves_torque_between_the_clutches():
    """(36)-(38) for 0.05 rad of twist: the shafts are springs in series, k = k_1 k_2/(k_1 + k_2).

    dT_c1 = k 0.05/i_t1², dT_c2 = -k 0.05/(i_t1 i_t2): what one shaft gains at the wheels the other loses.
    """
    k_1, k_2 = (shaft.transfer_stiffness_nm_per_rad for shaft in VEHICLE.shafts)
    i_1, i_2 = VEHICLE.gear(1).ratio, VEHICLE.gear(2).ratio
    k = k_1 * k_2 / (k_1 + k_2)
    settings = with_design(**SLOW, road_load=RoadLoad.NONE)
    twisted = at(estimates(settings, 1.15, pulse), 1120)
    plain = at(estimates(settings, 1.15, lambda t: pulse(0.0)), 1120)
    assert twisted["clutch1_torque_nm"] - plain["clutch1_torque_nm"] == pytest.approx(k * 0.05 / i_1**2, rel=0.06)
    assert twisted["clutch2_torque_nm"] - plain["clutch2_torque_nm"] == pytest.approx(
        -k * 0.05 / (i_1 * i_2), rel=0.06
    )


def test_unknown_input_mode_shows_no_twist():
    """In this mode the published torques are (65) and (66) themselves."""
    rows = estimates(
        with_design(**SLOW, road_load=RoadLoad.NONE, sub_observer=SubObserver.UNKNOWN_INPUT), 1.15, pulse
    )
    full = estimates(with_design(**SLOW, road_load=RoadLoad.NONE), 1.15, pulse)
    for i in "12":
        assert (rows[f"clutch{i}_torque_nm"] == rows[f"clutch{i}_torque_uio_nm"]).all()
        assert not (full[f"clutch{i}_torque_nm"] == full[f"clutch{i}_torque_uio_nm"])[-20:].any()


@pytest.mark.parametrize("closed", [1, 2])
def test_the_literal_paper_is_blind_when_cruising(closed):
    """At steady speed T_o = T_a1 = 0, so without gating (65), (66) give clutch 2 R_1 T_c/(R_1 - R_2)."""
    positions = {Q.CLUTCH1_POSITION: 10.0 * (closed == 1), Q.CLUTCH2_POSITION: 10.0 * (closed == 2)}
    ungated = with_design(road_load=RoadLoad.NONE, phase_gating=False)
    row = estimates(ungated, 1.5, lambda t: cruise(60.0) | positions)[-1]
    assert row["clutch2_torque_nm"] == pytest.approx(60.0 * R[1] / (R[1] - R[2]), rel=0.01)
    assert row["clutch1_torque_nm"] == pytest.approx(-60.0 * R[2] / (R[1] - R[2]), rel=0.01)
    assert row["road_load_nm"] == 0.0
    gated = estimates(LITERAL, 1.5, lambda t: cruise(60.0) | positions)[-1]
    assert gated[f"clutch{closed}_torque_nm"] == pytest.approx(60.0, rel=0.01)
    assert gated[f"clutch{3 - closed}_torque_nm"] == 0.0


@pytest.mark.parametrize("wheel", [20.0, 60.0])
def test_flat_road_load(wheel):
    """FLAT takes (11) at the present speed, whatever the clutches carry."""
    chassis = VEHICLE.chassis
    v = wheel * chassis.wheel_radius_m
    expected = chassis.wheel_radius_m * (
        chassis.rolling_resistance * chassis.mass_kg * 9.80665
        + 0.6 * v**2 * chassis.drag_coefficient * chassis.frontal_area_m2
    )
    ramp = estimates(
        with_design(road_load=RoadLoad.FLAT),
        2.5,
        lambda t: cruise(60.0, 40.0, 10.0 + (wheel - 10.0) * min(t / 2.0, 1.0), g1=3),
    )
    assert ramp[-1]["road_load_nm"] == pytest.approx(expected, rel=1e-3)
    assert not ramp[-1]["status"] & LEARNED


@pytest.mark.parametrize(("torque", "eta"), [(60.0, EFFICIENCY), (-60.0, 1.0 / EFFICIENCY)])
@pytest.mark.parametrize("clutch", [1, 2])
def test_one_clutch_teaches_the_load(clutch, torque, eta):
    """At steady speed the road load is η^±1 R T_c of the clutch that carries, 1 or 2, driving or coasting."""
    positions = (10.0, 0.0) if clutch == 1 else (0.0, 10.0)
    row = estimates(
        SETTINGS,
        2.5,
        lambda t: cruise(torque) | dict(zip((Q.CLUTCH1_POSITION, Q.CLUTCH2_POSITION), positions, strict=True)),
    )[-1]
    assert row["road_load_nm"] == pytest.approx(eta * R[clutch] * torque, rel=0.02)
    assert row["output_torque_nm"] == pytest.approx(eta * R[clutch] * torque, rel=0.02)
    assert row["status"] == READY | VALID | LEARNED


@pytest.mark.parametrize("dw", [3.0, -3.0])
def test_shaft_speeds_go_on_between_their_frames(dw):
    """A locked clutch has no slip in any row while the speeds ramp; clutch 2's is ω_e (1 - R_2/R_1)."""
    rows = estimates(SETTINGS, 1.0, rolling(dw, 25.0))
    rows = rows[rows["t_us"] > 500_000]
    assert np.abs(rows["clutch1_slip_rad_s"]).max() < 0.03
    np.testing.assert_allclose(
        rows["clutch2_slip_rad_s"], rows["engine_speed_rad_s"] * (1.0 - R[2] / R[1]), atol=0.03
    )
    np.testing.assert_allclose(rows["engine_speed_rad_s"], (25.0 + dw * rows["t_us"] * 1e-6) * R[1], atol=0.03)


@pytest.mark.parametrize("shaft_from", [1.2, 1.21])
@pytest.mark.parametrize("position", [10.0, 0.0])
def test_a_gear_change_is_no_twist(shaft_from, position):
    """Shaft 1 goes from first to third within a frame; (36)-(38) would read 3000 N·m from its old speed.

    Nor is its new speed an acceleration to the clutch-side observer, whichever of speed and gear comes first.
    """
    settings = with_design(**SLOW, phase_gating=False, road_load=RoadLoad.NONE)

    def values(t):
        return cruise(0.0, 40.0) | {
            Q.CLUTCH1_POSITION: position,
            Q.GEAR1: 1 if t < 1.2 else 3,
            Q.SHAFT1_SPEED: 20.0 * R[1 if t < shaft_from else 3],
        }

    rows = estimates(settings, 1.3, values)
    for i in "12":
        assert np.abs(rows[f"clutch{i}_torque_nm"]).max() < 10.0
        if shaft_from > 1.2:
            assert np.abs(rows[f"clutch{i}_torque_uio_nm"]).max() < 1.0
    assert timeline(rows, column="gear1") == [(0.0, 0), (5.0, 1), (1205.0, 3)]


@pytest.mark.parametrize("lost", [WHEELS[:2], WHEELS[2:]])
def test_another_axle_takes_over(lost):
    """The driven front wheels slip by 3 %, and one axle says nothing for a while.

    200 ms after its last speed the other axle stands in, the 3 % being no acceleration; and back.
    """

    def values(t):
        now = rolling(2.0)(t)
        for q in WHEELS[:2]:
            now[q] *= 1.03
        return now | (dict.fromkeys(lost) if 1.2 <= t < 1.8 else {})

    rows = estimates(with_design(acceleration_bandwidth_rad_s=65.0), 2.2, values)
    rows = rows[rows["t_us"] > 1_050_000]
    assert timeline(rows)[1:] == [
        (1400.0, READY | VALID | LEARNED | S.INPUT_STALE),
        (1807.5, READY | VALID | LEARNED),
    ]
    np.testing.assert_allclose(rows["wheel_acceleration_rad_s2"], 2.0, atol=0.3)


@pytest.mark.parametrize("period_ms", [20, 100, 250])
def test_seldom_wheel_speeds(period_ms):
    """Wheel speeds every 20 to 250 ms give the acceleration of a ramp all the same."""
    settings = replace(
        SETTINGS,
        inputs=tuple(replace(i, timeout_us=1_000_000) if i.quantity in WHEELS else i for i in SETTINGS.inputs),
    )
    data = traffic(3.0, rolling(4.0))
    wheel = (data.quantity >= Q.WHEEL_SPEED_FL) & (data.quantity <= Q.WHEEL_SPEED_RR)
    rows = Estimator(settings).feed(data[~wheel | ((data.t_us - 7500) % (period_ms * 1000) == 0)]).rows
    np.testing.assert_allclose(rows["wheel_acceleration_rad_s2"][rows["t_us"] > 2_000_000], 4.0, rtol=0.02)


def test_lock_and_release():
    """Small slip locks after 50 ms; 4.5 rad/s keeps a locked clutch (release: 6) but locks no slipping one."""

    def values(t):
        slip = np.interp(t, [0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.7, 1.9], [0.0, 4.5, 4.5, 8.0, 8.0, 4.5, 4.5, 0.0])
        return cruise(60.0, float(slip))

    table = timeline(estimates(SETTINGS, 2.2, values), column="phase1")
    assert [phase for _, phase in table] == [SLIPPING, LOCKED, SLIPPING, LOCKED]
    assert table[1][0] == 52.5  # the shafts were there at 2.5 ms
    assert table[2][0] == pytest.approx(985.7, abs=8.0)  # 6 rad/s
    assert table[3][0] == pytest.approx(1766.7 + 50.0, abs=8.0)  # 3 rad/s


INFERRING = replace(
    SETTINGS,
    gear_inference=GearInference(0.02, 0.05, 60_000, 3.0),
    inputs=tuple(i for i in SETTINGS.inputs if i.quantity not in (Q.GEAR1, Q.GEAR2)),
)


def inferred(seconds, values):
    def without_gears(t):
        return {q: v for q, v in values(t).items() if q not in (Q.GEAR1, Q.GEAR2)}

    return estimates(INFERRING, seconds, without_gears)


def test_a_gear_must_show_for_60_ms():
    """The ratio of shaft 2 is wrong for 40 ms: nothing; for 100 ms: out of gear after 60 ms, back likewise."""

    def values(t):
        return cruise() | ({Q.SHAFT2_SPEED: 20.0 * R[2] * 0.9} if 0.5 < t < 0.54 or 1.0 < t < 1.1 else {})

    rows = inferred(1.4, values)
    assert timeline(rows, column="gear2") == [(0.0, 0), (67.5, 2), (1062.5, 0), (1162.5, 2)]
    assert not (rows["status"][rows["t_us"] < 67_500] & S.GEARS_KNOWN).any()
    assert timeline(rows)[-1][1] & S.GEARS_KNOWN


def test_a_gear_has_hysteresis():
    """A ratio 3 % off keeps the gear (release: 5 %) and does not engage it (2 %)."""
    off = {Q.SHAFT2_SPEED: 20.0 * R[2] * 1.03}
    rows = inferred(1.0, lambda t: cruise() | (off if t > 0.5 else {}))
    assert timeline(rows, column="gear2") == [(0.0, 0), (67.5, 2)]
    rows = inferred(1.0, lambda t: cruise() | off)
    assert timeline(rows, column="gear2") == [(0.0, 0)]
    assert timeline(rows)[-1][1] & S.GEARS_KNOWN


def test_slow_wheels_tell_no_gear():
    """Below 3 rad/s the last gears stay, whatever the ratio; at rest the lowest are expected and not known."""

    def values(t):
        if t < 0.5:
            return cruise(g1=3, g2=4, wheel=4.0)
        wheel = 2.0 if t < 1.0 else 0.1
        return cruise(g1=3, g2=4, wheel=wheel) | {Q.SHAFT1_SPEED: 0.0, Q.SHAFT2_SPEED: 0.0}

    rows = inferred(1.5, values)
    assert timeline(rows, column="gear1") == [(0.0, 0), (67.5, 3), (1007.5, 1)]
    assert timeline(rows, column="gear2") == [(0.0, 0), (67.5, 4), (1007.5, 2)]
    assert at(rows, 900)["status"] & S.GEARS_KNOWN
    assert not at(rows, 1100)["status"] & (S.GEARS_KNOWN | VALID)


def test_one_missing_torque_value_restarts_nothing():
    """A single "no value" is bridged by the last one: the same torques, and valid throughout."""
    data = traffic(1.5, lambda t: cruise())
    status = data.status.copy()
    status[np.flatnonzero((data.quantity == Q.ENGINE_TORQUE) & (data.t_us > 1_200_000))[0]] = (
        SampleStatus.NOT_AVAILABLE
    )
    rows = Estimator(SETTINGS).feed(replace(data, status=status)).rows
    np.testing.assert_array_equal(
        rows["clutch1_torque_nm"], estimates(SETTINGS, 1.5, lambda t: cruise())["clutch1_torque_nm"]
    )
    assert timeline(rows)[-1] == (1007.5, READY | VALID | LEARNED)


def test_no_samples_give_nothing():
    estimator = Estimator(SETTINGS)
    assert len(estimator.feed(samples([]))) == 0
    assert estimator.health["accepted"].sum() == 0
