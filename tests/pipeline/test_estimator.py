"""The core: the same bits however cut, finite whatever comes, and every rule for bad time and bad input."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dctorque_can.driveline.parameters import DrivenAxle
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.errors import DctorqueError
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import FEW, Estimator
from dctorque_can.pipeline.samples import Samples, SampleStatus

from .drives import SETTINGS, VEHICLE, Q, R, known, locked_in_first, samples, traffic, with_either


@with_either
def test_locked_drive_gives_the_closed_form(settings):
    values, T_c, T_o = locked_in_first()
    estimator = Estimator(settings)
    row = estimator.feed(traffic(3.0, values)).rows[-1]
    assert row["clutch1_torque_nm"] == pytest.approx(T_c, abs=0.2 + 2.0 * np.nan_to_num(row["clutch1_sigma_nm"]))
    drag = VEHICLE.clutches[1].drag_nms_per_rad * row["clutch2_slip_rad_s"]  # which the 2014 observer leaves out
    expected = drag if settings.method is Method.KALMAN else 0.0
    assert row["clutch2_torque_nm"] == pytest.approx(expected, abs=2.0 * np.nan_to_num(row["clutch2_sigma_nm"]))
    if settings.method is Method.OH2014:
        assert row["output_torque_adaptive_nm"] == pytest.approx(T_o, rel=0.01)
    assert Status(int(row["status"])) & Status.CLUTCH1_VALID
    assert (row["phase1"], row["phase2"]) == (ClutchPhase.LOCKED, ClutchPhase.OPEN)
    assert (row["gear1"], row["gear2"]) == (1, 2)


def test_the_inbox_is_fed_as_any_samples_are():
    data = traffic(0.5, locked_in_first()[0])
    whole, live = Estimator(SETTINGS), Estimator(SETTINGS)
    rows = []
    for start in range(0, len(data), FEW):
        part = data[start : start + FEW]
        for name in Samples.__slots__:
            getattr(live.inbox, name)[: len(part)] = getattr(part, name)
        rows.append(live.feed_inbox(len(part)).rows)
    assert len(rows) > 1
    assert np.concatenate(rows).tobytes() == whole.feed(data).rows.tobytes()
    assert live.health.tobytes() == whole.health.tobytes()
    for n in (-1, FEW + 1):
        with pytest.raises(ValueError, match="inbox"):
            live.feed_inbox(n)


@with_either
def test_both_clutches_are_told_apart(settings):
    """Clutch 1 and 2 slip together and carry known torques; steady speeds make (65), (66) exact."""
    T_1, T_2 = 30.0, 60.0
    values, _, _ = locked_in_first()
    base = values(0.0)
    base[Q.ENGINE_SPEED] += 40.0
    efficiency = VEHICLE.gear_efficiency * VEHICLE.final_drive_efficiency
    T_o = efficiency * (R[1] * T_1 + R[2] * T_2)

    def single(t):
        return base | {Q.ENGINE_TORQUE: T_o / efficiency / R[1]}

    def both(t):
        return base | {
            Q.ENGINE_TORQUE: T_1 + T_2,
            Q.CLUTCH2_POSITION: 6.0,
        }

    estimator = Estimator(settings)
    estimator.feed(traffic(4.0, single))
    row = estimator.feed(traffic(4.0, both, start_us=4_000_000)).rows[-1]
    assert row["clutch1_torque_nm"] == pytest.approx(T_1, abs=1.5 + 2.0 * np.nan_to_num(row["clutch1_sigma_nm"]))
    assert row["clutch2_torque_nm"] == pytest.approx(T_2, abs=1.5 + 2.0 * np.nan_to_num(row["clutch2_sigma_nm"]))
    assert row["output_torque_nm"] == pytest.approx(
        T_o, abs=0.02 * T_o + 2.0 * np.nan_to_num(row["output_sigma_nm"])
    )


@st.composite
def noisy_traffic(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values, _, _ = locked_in_first()
    data = traffic(draw(st.floats(0.1, 1.0)), values)
    value = data.value + rng.normal(0, 2, len(data)) * (data.quantity < 8)
    value[rng.random(len(data)) < 0.02] = 6.0  # odd positions, gears and speeds
    status = np.where(rng.random(len(data)) < 0.05, rng.integers(1, 6, len(data)), 0).astype(np.uint8)
    t_us = data.t_us.copy()
    if draw(st.booleans()) and len(data) > 8:
        t_us[len(data) // 2 :] += draw(st.integers(-3_000_000, 3_000_000))
    return Samples(t_us, data.quantity, value, status, data.last)


@given(noisy_traffic(), st.lists(st.integers(0, 1500), max_size=12))
def test_cuts_change_no_bit(data, cuts):
    whole = Estimator(SETTINGS).feed(data)
    estimator = Estimator(SETTINGS)
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    parts = [estimator.feed(data[a:b]) for a, b in pairwise(edges)]
    assert np.concatenate([p.rows for p in parts]).tobytes() == whole.rows.tobytes()
    assert np.concatenate([p.health for p in parts]).tobytes() == whole.health.tobytes()


@given(noisy_traffic(), st.integers(-(10**15), 10**15))
def test_only_differences_of_time_matter(data, shift_us):
    """A log that keeps relative times alone (ASC) gives the same estimates."""
    here = Estimator(SETTINGS).feed(data)
    there = Estimator(SETTINGS).feed(replace(data, t_us=data.t_us + shift_us))
    there.rows["t_us"] -= shift_us
    there.health["t_us"] -= shift_us
    assert there.rows.tobytes() == here.rows.tobytes()
    assert there.health.tobytes() == here.health.tobytes()


@given(
    st.lists(
        st.tuples(
            st.integers(-(10**7), 10**7),
            st.sampled_from(list(Q)),
            st.floats(allow_nan=False, allow_infinity=False),
            st.sampled_from([SampleStatus.OK] * 6 + list(SampleStatus)),
            st.booleans(),
        ),
        max_size=300,
    )
)
def test_finite_for_any_finite_input(rows):
    values, _, _ = locked_in_first()
    estimator = Estimator(SETTINGS)
    for batch in (traffic(0.2, values), samples(rows), traffic(0.1, values, 500_000)):
        result = estimator.feed(batch)
        for name in known(SETTINGS.method):
            assert np.isfinite(result.rows[name].astype(float)).all(), name


@given(st.integers(0, 2**32 - 1))
def test_wild_measurements_stay_finite(seed):
    """Every speed and torque anywhere within its allowed range, at the rates of a bus."""
    rng = np.random.default_rng(seed)
    values, _, _ = locked_in_first()
    data = traffic(0.5, values)
    limit = {item.quantity: (max(item.minimum, -1e6), min(item.maximum, 1e6)) for item in SETTINGS.inputs}
    value = np.array(
        [
            rng.uniform(*limit[Q(q)]) if q in limit and q < 8 else v
            for q, v in zip(data.quantity, data.value, strict=True)
        ]
    )
    rows = Estimator(SETTINGS).feed(Samples(data.t_us, data.quantity, value, data.status, data.last)).rows
    assert len(rows) > 100
    for name in known(SETTINGS.method):
        assert np.isfinite(rows[name].astype(float)).all(), name


@with_either
def test_rejected_samples_change_nothing_but_counters(settings):
    """Whatever fails its CRC, counter, length or range leaves the estimates bit for bit as they were."""
    values, _, _ = locked_in_first()
    data = traffic(1.0, values)
    bad = [
        (int(t) + 100, Q.ENGINE_SPEED, 0.0, status, True)
        for t, status in zip(data.t_us[::7], [2, 3, 4, 5] * len(data), strict=False)
    ]
    mixed_rows = sorted(
        [*zip(data.t_us, data.quantity, data.value, data.status, data.last, strict=True), *bad], key=lambda r: r[0]
    )
    clean, dirty = Estimator(settings), Estimator(settings)
    assert clean.feed(data).rows.tobytes() == dirty.feed(samples(mixed_rows)).rows.tobytes()
    health = dirty.health[0]
    counted = sum(
        int(health[name][Q.ENGINE_SPEED]) for name in ("out_of_range", "bad_length", "bad_crc", "bad_counter")
    )
    assert counted == len(bad)


def test_engine_torque_missing():
    """Engine torque stops for 300 ms: held until its timeout, then stale and not valid; valid again after."""
    values, _, _ = locked_in_first()
    data = traffic(3.0, values)
    gone = (data.quantity == Q.ENGINE_TORQUE) & (data.t_us > 1_000_000) & (data.t_us < 1_300_000)
    status = np.where(gone, SampleStatus.NOT_AVAILABLE, data.status).astype(np.uint8)
    estimator = Estimator(SETTINGS)
    rows = estimator.feed(Samples(data.t_us, data.quantity, data.value, status, data.last)).rows
    before = rows[(rows["t_us"] > 1_050_000) & (rows["t_us"] < 1_090_000)]
    assert (before["status"] & Status.CLUTCH1_VALID).all()
    during = rows[(rows["t_us"] > 1_110_000) & (rows["t_us"] < 1_290_000)]
    assert (during["status"] & Status.INPUT_STALE).all()
    assert not (during["status"] & (Status.CLUTCH1_VALID | Status.OUTPUT_VALID)).any()
    assert len(np.unique(during["clutch1_torque_nm"])) == 1
    after = rows[np.searchsorted(rows["t_us"], 1_450_000)]
    assert after["status"] & Status.CLUTCH1_VALID
    assert after["status"] & Status.ROAD_LOAD_LEARNED  # not forgotten over a short pause
    assert rows[-1]["status"] & Status.CLUTCH1_VALID


@with_either
def test_frame_gap_of_two_seconds_resets_once(settings):
    values, T_c, _ = locked_in_first()
    estimator = Estimator(settings)
    estimator.feed(traffic(1.0, values))
    rows = estimator.feed(traffic(1.0, values, 3_000_000)).rows
    assert int(estimator.health["gap_resets"][0]) == 1
    assert not rows[0]["status"] & Status.CONVERGED
    assert rows[-1]["clutch1_torque_nm"] == pytest.approx(T_c, rel=0.1)


@with_either
def test_clock_step_back_resets_once_and_goes_on(settings):
    values, _, _ = locked_in_first()
    estimator = Estimator(settings)
    estimator.feed(traffic(1.0, values, 3_600_000_000))
    rows = estimator.feed(traffic(1.0, values, 0)).rows
    assert int(estimator.health["clock_resets"][0]) == 1
    assert rows[-1]["t_us"] == 997_500
    assert rows[-1]["status"] & Status.CLUTCH1_VALID


@with_either
def test_frames_slightly_out_of_order_are_late_not_lost(settings):
    values, T_c, _ = locked_in_first()
    data = traffic(2.0, values)
    order = np.arange(len(data))
    first = np.flatnonzero(data.quantity == Q.WHEEL_SPEED_FL)[10]
    order[first - 4 : first + 4] = np.roll(order[first - 4 : first + 4], 4)  # two frames change places
    estimator = Estimator(settings)
    rows = estimator.feed(data[order]).rows
    assert int(estimator.health["late_frames"][0]) >= 1
    assert (np.diff(rows["t_us"]) >= 0).all()
    assert rows[-1]["clutch1_torque_nm"] == pytest.approx(
        T_c, abs=0.3 + 2.0 * np.nan_to_num(rows[-1]["clutch1_sigma_nm"])
    )


@with_either
def test_stale_input_is_counted_once(settings):
    values, _, _ = locked_in_first()
    data = traffic(2.0, values)
    wheels = (data.quantity >= Q.WHEEL_SPEED_FL) & (data.quantity <= Q.WHEEL_SPEED_RR)
    estimator = Estimator(settings)
    estimator.feed(data[~(wheels & (data.t_us > 1_000_000))])
    assert int(estimator.health["timeouts"][0][Q.WHEEL_SPEED_RL]) == 1


@pytest.mark.parametrize("axle", list(DrivenAxle))
def test_undriven_wheels_give_the_acceleration(axle):
    """A spinning driven axle is not taken for the car's acceleration; with four driven wheels there is no help."""
    values, _, _ = locked_in_first()
    accelerations = []
    for spinning in ((Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_FR), (Q.WHEEL_SPEED_RL, Q.WHEEL_SPEED_RR)):
        data = traffic(1.0, lambda t, spin=spinning: values(t) | {q: values(t)[q] * (1 + 0.2 * t) for q in spin})
        rows = Estimator(replace(SETTINGS, driven_axle=axle)).feed(data).rows
        accelerations.append(float(rows[-1]["wheel_acceleration_rad_s2"]))
    truth = (values(1.0)[Q.WHEEL_SPEED_FL] - values(0.0)[Q.WHEEL_SPEED_FL]) / 1.0
    deviates = [abs(a - truth) > 0.5 for a in accelerations]
    assert (
        deviates
        == {
            DrivenAxle.FRONT: [False, True],
            DrivenAxle.REAR: [True, False],
            DrivenAxle.ALL: [True, True],
        }[axle]
    )


def test_equal_ratios_are_refused():
    gears = tuple(replace(g, ratio=3.78) if g.number == 2 else g for g in VEHICLE.gears)
    with pytest.raises(DctorqueError, match="gears 1 and 2 have the same total ratio"):
        Estimator(replace(SETTINGS, vehicle=replace(VEHICLE, gears=gears)))
