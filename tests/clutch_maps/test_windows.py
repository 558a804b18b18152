"""Samples and estimates joined: at the right instant, whatever the batches, and only what may teach."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dctorque_can.clutch_maps.windows import WINDOW_US, Join
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.samples import Quantity, SampleStatus

from .car import rows_of, samples_of, settings

SECOND = 1_000_000


def ramp(seconds=2.0, **columns):
    """Return samples each 10 ms, 3 ms off the rows' 10 ms, while position and torque rise steadily."""
    t_rows = np.arange(0, int(seconds * SECOND), 10_000)
    t_samples = t_rows + 3_000
    return samples_of(t_samples, 4.0 + t_samples * 1e-6), rows_of(t_rows, 50.0 + 20.0 * t_rows * 1e-6, **columns)


def test_torque_and_actuation_are_those_of_the_same_instants():
    """Both rise straight, so that whatever the instants are, one follows from the other."""
    samples, rows = ramp()
    seen = Join(settings()).take(samples, rows).observations
    assert len(seen) == 39
    np.testing.assert_allclose(seen["torque_nm"], 50.0 + 20.0 * (seen["x"] - 4.0), atol=1e-9)
    np.testing.assert_allclose(seen["rate"], 1.0, rtol=1e-9)
    assert set(np.diff(seen["key"])) == {WINDOW_US}


def test_a_known_delay_is_taken_off():
    rules = settings()
    late = tuple(replace(clutch, delay_us=20_000) for clutch in rules.clutches)
    samples, rows = ramp()
    seen = Join(replace(rules, clutches=late)).take(samples, rows).observations
    np.testing.assert_allclose(seen["torque_nm"], 50.0 + 20.0 * (seen["x"] - 0.02 - 4.0), atol=1e-9)


def test_a_clutch_that_closes_by_falling_counts_the_other_way():
    samples, rows = ramp()
    seen = Join(settings(sign=-1.0)).take(samples, rows).observations
    assert seen["x"].max() < -4.0
    np.testing.assert_allclose(seen["rate"], -1.0, rtol=1e-9)


def test_a_clutch_that_drives_backwards_carries_its_capacity_too():
    samples, rows = ramp()
    rows["clutch1_torque_nm"] *= -1.0
    rows["clutch1_slip_rad_s"] *= -1.0
    seen = Join(settings()).take(samples, rows).observations
    assert seen["torque_nm"].min() > 50.0
    assert np.all(seen["slip_rad_s"] == 60.0)


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("phase1", 2),
        ("phase1", 0),
        ("gear1", 0),
        ("clutch1_slip_rad_s", 5.0),
        ("clutch1_sigma_nm", np.nan),
        ("status", 0),
        ("status", Status.CLUTCH1_VALID | Status.LIMITED),
        ("status", Status.CLUTCH1_VALID | Status.ENGINE_TORQUE_FAULT),
        ("status", Status.CLUTCH1_VALID | Status.VEHICLE_FILE_IMPLAUSIBLE),
    ],
)
def test_one_row_that_may_not_teach_spoils_its_window(column, value):
    samples, rows = ramp()
    rows[column][102] = value  # at 1.02 s
    seen = Join(settings()).take(samples, rows).observations
    missing = set(range(2 * WINDOW_US, 39 * WINDOW_US + 1, WINDOW_US)) - set(seen["key"].tolist())
    assert missing == {21 * WINDOW_US}


def test_a_slip_that_turns_does_not_teach():
    samples, rows = ramp()
    rows["clutch1_slip_rad_s"][102:] = -60.0
    seen = Join(settings()).take(samples, rows).observations
    assert 21 * WINDOW_US not in seen["key"]


def test_positions_that_stop_coming_do_not_teach():
    samples, rows = ramp()
    kept = (samples.t_us < SECOND) | (samples.t_us > 1_300_000)
    seen = Join(settings()).take(samples[kept], rows).observations
    assert not np.any((seen["key"] > SECOND + WINDOW_US) & (seen["key"] <= 1_300_000))


@pytest.mark.parametrize("clock_steps", [False, True])
def test_batches_change_nothing(clock_steps):
    samples, rows = ramp(3.0)
    if clock_steps:
        samples.t_us[150:] -= 700_000
        rows["t_us"][150:] -= 700_000
    whole = Join(settings()).take(samples, rows)
    random = np.random.default_rng(4)
    cuts = [0, *np.sort(random.integers(0, len(rows), 60)).tolist(), len(rows)]
    join = Join(settings())
    parts = [join.take(samples[slice(a, b)], rows[a:b]) for a, b in pairwise(cuts)]
    parts = [part for part in parts if part is not None]
    for name in ("keys", "t_us", "speeds_m_s", "observations"):
        joined, expected = np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name)
        for field in expected.dtype.names or (...,):
            np.testing.assert_array_equal(joined[field], expected[field])
    assert sum(len(part.rows) - 1 for part in parts) == len(whole.rows) - 1
    assert np.all(np.diff(whole.keys) > 0)


def test_samples_that_are_late_count_with_the_latest_and_bad_ones_not_at_all():
    samples, rows = ramp()
    samples.t_us[50] -= 40_000
    samples.status[70] = SampleStatus.BAD_CRC
    samples.value[70] = 1e9
    seen = Join(settings()).take(samples, rows).observations
    assert seen["x"].max() < 7.0


def test_the_speed_is_that_behind_the_gear():
    samples, rows = ramp()
    joined = Join(settings()).take(samples, rows)
    np.testing.assert_allclose(joined.speeds_m_s, (160.0 - 60.0) / 10.0 * 0.3)


def test_the_other_clutch_has_its_own():
    samples, rows = ramp()
    samples.quantity[:] = Quantity.CLUTCH2_POSITION
    assert len(Join(settings()).take(samples, rows).observations) == 0  # clutch 2 is open
