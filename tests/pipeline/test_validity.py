"""What every status bit says over the course of a drive, as exact tables of (ms, status)."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.estimators.methods import Method
from dctorque_can.estimators.oh2014.design import RoadLoad, SubObserver
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import SampleStatus

from .drives import (
    KNOWN,
    LEARNED,
    LEARNED_MS,
    READY,
    SETTINGS,
    SETTLED_MS,
    VALID,
    VEHICLE,
    Q,
    R,
    S,
    at,
    cruise,
    estimates,
    known,
    samples,
    timeline,
    traffic,
    with_design,
)

START = [(0.0, S.INPUT_STALE), (5.0, S.INPUT_STALE | KNOWN), (7.5, KNOWN)]
GRADE = {Q.ENGINE_TORQUE: 60.0, Q.CLUTCH2_POSITION: 6.0}


def test_start():
    """Stale until every input was there, then known, settled after 5/65 s, road load learned after 1 s."""
    rows = estimates(SETTINGS, 1.5, lambda t: cruise())
    assert timeline(rows) == [*START, (SETTLED_MS, READY | VALID), (LEARNED_MS, READY | VALID | LEARNED)]


def test_ungated_torques_stand_on_the_road_load():
    """Without gating (65), (66) run even with clutch 2 open: nothing is valid before the road load is learned."""
    rows = estimates(with_design(phase_gating=False), 1.5, lambda t: cruise())
    assert timeline(rows) == [*START, (SETTLED_MS, READY), (LEARNED_MS, READY | VALID | LEARNED)]


def test_both_clutches_open_learn_too():
    """With both open the whole load is found from coasting."""
    rows = estimates(SETTINGS, 1.2, lambda t: cruise(0.0) | {Q.CLUTCH1_POSITION: 0.0})
    assert timeline(rows)[-1] == (LEARNED_MS, READY | VALID | LEARNED)


def test_two_closed_clutches_need_a_learned_road_load():
    """From the start both may carry: never valid, nothing learned; the literal paper does not ask for it."""
    rows = estimates(SETTINGS, 1.5, lambda t: cruise() | GRADE)
    assert timeline(rows) == [*START, (SETTLED_MS, READY)]
    literal = with_design(road_load=RoadLoad.NONE)
    assert timeline(estimates(literal, 1.5, lambda t: cruise() | GRADE)) == [*START, (SETTLED_MS, READY | VALID)]


def test_the_adaptive_torque_alone():
    """Of ADAPTIVE only the output torque is valid, and that once the load is learned, if it is learned at all."""
    learning = with_design(sub_observer=SubObserver.ADAPTIVE)
    rows = estimates(learning, 1.5, lambda t: cruise())
    assert timeline(rows) == [
        *START,
        (SETTLED_MS, READY),
        (LEARNED_MS, READY | LEARNED | S.OUTPUT_VALID),
    ]
    assert not rows["clutch1_torque_nm"].any()
    literal = with_design(sub_observer=SubObserver.ADAPTIVE, road_load=RoadLoad.NONE)
    rows = estimates(literal, 0.5, lambda t: cruise())
    assert timeline(rows) == [*START, (SETTLED_MS, READY | S.OUTPUT_VALID)]


def test_brake_while_both_carry():
    """The brake takes validity away only where the split stands on the road load: with both clutches closed."""

    def values(t):
        both = {Q.CLUTCH2_POSITION: 6.0} if 1.2 <= t < 1.8 else {}
        return cruise() | both | {Q.BRAKE: float(1.1 <= t < 1.15 or 1.5 <= t < 1.6 or t >= 1.7)}

    table = timeline(estimates(SETTINGS, 2.0, values))
    assert table[4:] == [
        (LEARNED_MS, READY | VALID | LEARNED),
        (1500.0, READY | LEARNED),
        (1600.0, READY | VALID | LEARNED),
        (1700.0, READY | LEARNED),
        (1805.0, READY | VALID | LEARNED),
    ]


def test_more_torque_than_a_clutch_can_carry_is_limited():
    """1.5 · 4 · 0.31 · 0.13 m · 3000 N = 725.4 N·m: 900 are shown as 725.4, marked and not valid."""
    rows = estimates(SETTINGS, 1.5, lambda t: cruise(900.0 if t < 0.995 else 700.0))
    table = timeline(rows)
    assert (SETTLED_MS, READY | S.LIMITED) in table
    assert at(rows, 900)["clutch1_torque_nm"] == pytest.approx(725.4)
    assert at(rows, 900)["clutch_torque_sum_nm"] == pytest.approx(900.0)
    assert table[-1][1] == READY | VALID | LEARNED
    assert rows[-1]["clutch1_torque_nm"] == pytest.approx(700.0, abs=2.0)


def test_negative_torque_is_limited_too():
    """A drag of 900 N·m is shown as -725.4."""
    wide = replace(
        SETTINGS,
        inputs=tuple(replace(i, minimum=-2000.0) if i.quantity is Q.ENGINE_TORQUE else i for i in SETTINGS.inputs),
    )
    rows = estimates(wide, 0.5, lambda t: cruise(-900.0))
    assert rows[-1]["clutch1_torque_nm"] == pytest.approx(-725.4)
    assert Status(int(rows[-1]["status"])) == READY | S.LIMITED


@pytest.mark.parametrize("shaft", [Q.SHAFT1_SPEED, Q.SHAFT2_SPEED])
def test_a_shaft_that_does_not_fit(shaft):
    """Not valid at once, implausible after 300 ms, and settling anew then; a short glitch costs itself only."""

    def values(t):
        wrong = 1.1 <= t < 1.2 or 1.3 <= t < 1.8
        return cruise() | ({shaft: cruise()[shaft] * 1.2} if wrong else {})

    assert timeline(estimates(SETTINGS, 2.0, values))[4:] == [
        (LEARNED_MS, READY | VALID | LEARNED),
        (1102.5, READY | LEARNED),
        (1202.5, READY | VALID | LEARNED),
        (1302.5, READY | LEARNED),
        (1602.5, READY | LEARNED | S.SPEED_IMPLAUSIBLE),
        (1802.5, KNOWN | LEARNED),
        (1880.0, READY | VALID | LEARNED),
    ]


@pytest.mark.parametrize("shaft", [Q.SHAFT1_SPEED, Q.SHAFT2_SPEED])
def test_a_shaft_within_the_bound_fits(shaft):
    """14 % off is still taken."""
    rows = estimates(SETTINGS, 1.2, lambda t: cruise() | {shaft: cruise()[shaft] * 1.14})
    assert timeline(rows)[-1] == (LEARNED_MS, READY | VALID | LEARNED)


def test_a_lost_position_means_that_the_clutch_may_carry():
    """Clutch 2's position goes missing: stale after its 100 ms, slipping instead of open, and nothing is valid."""
    rows = estimates(SETTINGS, 1.6, lambda t: cruise() | ({Q.CLUTCH2_POSITION: None} if t > 1.2 else {}))
    lost = READY ^ S.PHASES_KNOWN
    assert timeline(rows)[4:] == [
        (LEARNED_MS, READY | VALID | LEARNED),
        (1297.5, lost | LEARNED | S.INPUT_STALE),
    ]
    assert timeline(rows, column="phase2") == [(0.0, 1), (5.0, 0), (1297.5, 1)]


def test_positions_that_were_never_there():
    """Both clutches may carry: not valid, but estimated."""

    def values(t):
        now = cruise()
        del now[Q.CLUTCH1_POSITION], now[Q.CLUTCH2_POSITION]
        return now

    rows = estimates(SETTINGS, 1.5, values)
    assert timeline(rows)[-1] == (SETTLED_MS, S.GEARS_KNOWN | S.CONVERGED)
    assert (rows[-1]["phase1"], rows[-1]["phase2"]) == (1, 1)
    assert rows[-1]["clutch2_torque_nm"] != 0.0


def test_a_gear_that_the_shaft_does_not_have():
    """Gear 3 is on shaft 1: on shaft 2 it is unknown, the observer is held, and starts anew afterwards."""
    rows = estimates(SETTINGS, 1.6, lambda t: cruise() | ({Q.GEAR2: 3} if 1.1 <= t < 1.3 else {}))
    assert timeline(rows)[4:] == [
        (LEARNED_MS, READY | VALID | LEARNED),
        (1105.0, S.PHASES_KNOWN | S.INPUT_STALE),
        (1305.0, KNOWN | LEARNED),
        (1382.5, READY | VALID | LEARNED),
    ]


@pytest.mark.parametrize(
    ("pause_s", "remembered"), [(2.0, True), (4.8, True), (5.2, False), (-3600.0, False), (1.76e9, False)]
)
def test_after_a_gap_everything_starts_anew(pause_s, remembered):
    """No old input is used; only the road load is kept, over 5 s."""
    start_us = 1_200_000 + round(pause_s * 1e6)
    estimator = Estimator(SETTINGS)
    estimator.feed(traffic(1.2, lambda t: cruise()))
    rows = estimator.feed(traffic(1.2, lambda t: cruise(), start_us)).rows
    kept = LEARNED if remembered else S(0)
    expected = [*START[:2], (7.5, KNOWN | kept), (SETTLED_MS, READY | VALID | kept)]
    if not remembered:
        expected.append((LEARNED_MS, READY | VALID | LEARNED))
    assert timeline(rows, start_us) == expected
    health = estimator.health[0]
    assert (health["gap_resets"], health["clock_resets"]) == ((1, 0) if pause_s > 0 else (0, 1))
    assert not health["timeouts"].any()  # what is dropped is not late
    load = 0.94 * 0.86 * R[1] * 60.0
    restarted = at(rows, (start_us + 7_500) / 1000)["road_load_nm"]
    assert restarted == pytest.approx(load, rel=0.01) if remembered else restarted < 0.2 * load


def test_ages_after_a_gap():
    """The last frame of every kind is 0 … 7.5 ms old; what has not come since the gap has no age."""
    estimator = Estimator(SETTINGS)
    estimator.feed(traffic(1.0, lambda t: cruise() | {Q.BRAKE: 0.0}))
    age = estimator.health["age_us"][0]
    assert [int(age[q]) for q in (Q.ENGINE_SPEED, Q.BRAKE, Q.SHAFT2_SPEED, Q.GEAR1, Q.WHEEL_SPEED_RR)] == [
        7500,
        7500,
        5000,
        2500,
        0,
    ]
    assert age[Q.GRADE] == -1
    estimator.feed(traffic(0.005, lambda t: cruise(), 3_000_000))
    age = estimator.health["age_us"][0]
    assert [int(age[q]) for q in (Q.ENGINE_SPEED, Q.SHAFT2_SPEED, Q.GEAR1, Q.BRAKE)] == [2500, 0, -1, -1]


def test_missing_values_advance_the_time():
    """Frames that say "no value" are sound: their time counts, and the input ages to its timeout."""
    estimator = Estimator(SETTINGS)
    estimator.feed(traffic(1.2, lambda t: cruise()))
    nothing = [
        (t, Q.ENGINE_TORQUE, 0.0, SampleStatus.NOT_AVAILABLE, True) for t in range(1_200_000, 1_400_000, 5000)
    ]
    rows = estimator.feed(samples(nothing)).rows
    assert rows["t_us"].tolist() == [t for t, *_ in nothing]
    assert timeline(rows) == [
        (1200.0, READY | VALID | LEARNED),
        (1295.0, KNOWN | S.INPUT_STALE),
        (1300.0, S.INPUT_STALE),  # gears and positions are missing too by now
    ]
    assert estimator.health["not_available"][0][Q.ENGINE_TORQUE] == len(nothing)


def test_only_sound_and_mapped_samples_count():
    """A frame with nothing but rejected or unmapped samples gives no estimate and moves no time."""
    clean, dirty = Estimator(SETTINGS), Estimator(SETTINGS)
    for estimator in (clean, dirty):
        estimator.feed(traffic(1.2, lambda t: cruise()))
    ignored = [
        (1_300_000, Q.ENGINE_SPEED, 1.0, SampleStatus.BAD_CRC, True),
        (1_400_000, Q.GRADE, 1.0, SampleStatus.OK, True),
        (1_400_000, Q.CLUTCH1_OPEN, 1.0, SampleStatus.OK, True),
        (1_450_000, Q.GRADE, 0.0, SampleStatus.NOT_AVAILABLE, True),
        (1_500_000, Q.ENGINE_SPEED, 1e5, SampleStatus.OK, True),
    ]
    assert len(dirty.feed(samples(ignored))) == 0
    assert dirty.health["t_us"] == clean.health["t_us"]
    assert dirty.health["accepted"].tolist() == clean.health["accepted"].tolist()
    more = traffic(0.2, lambda t: cruise(), 1_200_000)
    assert dirty.feed(more).rows.tobytes() == clean.feed(more).rows.tobytes()


def test_a_state_that_is_no_number_restarts():
    """A spoiled state is replaced within the same frame, counted once, and the drive goes on as from the start."""
    estimator = Estimator(SETTINGS)
    estimator.feed(traffic(1.2, lambda t: cruise()))
    estimator.chosen.state["observer"]["T_c"] = np.nan
    rows = estimator.feed(traffic(1.2, lambda t: cruise(), 1_200_000)).rows
    for name in known(SETTINGS.method):
        assert np.isfinite(rows[name].astype(float)).all(), name
    assert estimator.health["numeric_resets"][0] == 1
    assert timeline(rows, 1_200_000) == [
        (0.0, KNOWN | S.INPUT_STALE),
        (2.5, KNOWN),
        (80.0, READY | VALID),
        (1002.5, READY | VALID | LEARNED),
    ]


@pytest.mark.parametrize("state", ["x", "P"])
def test_a_filter_that_is_no_number_restarts(state):
    """So does the Kalman filter: no row of its torques, standard deviations or powers is spoiled."""
    estimator = Estimator(replace(SETTINGS, method=Method.KALMAN))
    estimator.feed(traffic(1.2, lambda t: cruise()))
    estimator.chosen.state[state] = np.nan
    rows = estimator.feed(traffic(1.2, lambda t: cruise(), 1_200_000)).rows
    for name in known(Method.KALMAN):
        assert np.isfinite(rows[name].astype(float)).all(), name
    assert estimator.health["numeric_resets"][0] == 1
    assert timeline(rows, 1_200_000)[0] == (0.0, KNOWN | S.INPUT_STALE)
    assert rows["clutch1_torque_nm"][-1] == pytest.approx(60.0, abs=5.0)


def test_any_time_is_survived():
    """Times up to the limits of 64 bits end at once in counted resets, clamped to ±2^60 µs."""
    times = [-5 * 10**18, 5 * 10**18, 0, 1_790_000_000_000_000, 2**63 - 1, -(2**63), 10]
    estimator = Estimator(SETTINGS)
    rows = estimator.feed(samples([(t, Q.ENGINE_SPEED, 100.0, SampleStatus.OK, True) for t in times])).rows
    assert rows["t_us"].tolist() == [max(-(2**60), min(t, 2**60)) for t in times]
    assert (estimator.health["gap_resets"][0], estimator.health["clock_resets"][0]) == (4, 2)
    rows = estimator.feed(traffic(0.2, lambda t: cruise(), 1_790_000_000_000_000)).rows
    assert timeline(rows, 1_790_000_000_000_000) == [*START, (SETTLED_MS, READY | VALID)]


def test_limits_are_those_of_the_vehicle():
    """The table above assumes these capacities."""
    clutch = VEHICLE.clutches[0]
    assert (
        1.5 * clutch.surfaces * clutch.friction_static * clutch.effective_radius_m * clutch.max_normal_force_n
        == (pytest.approx(725.4))
    )


def test_the_other_axle_judges_the_shafts():
    """Without the driven wheels' speeds a shaft is held against the others'."""

    def values(t):
        now = {q: v for q, v in cruise().items() if q not in (Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_FR)}
        return now | {Q.SHAFT2_SPEED: cruise()[Q.SHAFT2_SPEED] * 1.2}

    assert timeline(estimates(SETTINGS, 0.5, values))[-1] == (307.5, READY | S.SPEED_IMPLAUSIBLE)
