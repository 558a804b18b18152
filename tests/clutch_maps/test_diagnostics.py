"""Counters against what was done by hand."""

import numpy as np
import pytest

from dctorque_can.clutch_maps.diagnostics import Diagnostics
from dctorque_can.clutch_maps.friction import COOLING_S, Warmth
from dctorque_can.clutch_maps.rows import CLUTCH_MAP
from dctorque_can.pipeline.estimates import Status

from .car import rows_of


def reported(diagnostics):
    row = np.zeros(1, CLUTCH_MAP)[0]
    diagnostics.report(row)
    return row


def test_engagements_by_energy_and_the_work_in_all():
    """Three engagements end with 0.5, 3 and 60 kJ; a fourth goes on; before the second the energy is not known."""
    energies = np.repeat([0.0, 500.0, 3_000.0, 60_000.0, 10.0], 10)
    count = np.repeat([0, 1, 2, 3, 4], 10)
    rows = rows_of(np.arange(50) * 10_000, 50.0, clutch1_energy_j=energies, clutch1_engagements=count)
    rows["clutch1_heat_j"] = np.linspace(0.0, 63_510.0, 50)
    rows["status"][10:20] &= ~np.uint32(Status.ENERGY1_KNOWN)
    one = Diagnostics()
    one.count(0, rows[:30], np.array([4, 29]))
    one.count(0, rows[29:], np.array([], np.intp))
    row = reported(one)
    assert row["engagements"].tolist() == [0, 1, 0, 0, 1]
    assert row["energy_j"] == pytest.approx(63_510.0)


def test_an_estimator_begun_anew_takes_no_work_away():
    rows = rows_of(np.arange(4), 50.0, clutch1_heat_j=[100.0, 300.0, 0.0, 50.0])
    one = Diagnostics()
    one.count(0, rows, np.array([], np.intp))
    assert one.energy_j == 250.0


def test_time_at_temperature():
    rows = rows_of(np.arange(5), 50.0, clutch1_temperature_c=[90.0, 120.0, 120.0, 310.0, 400.0])
    rows["status"] |= np.uint32(Status.TEMPERATURE1_KNOWN)
    rows["status"][4] &= ~np.uint32(Status.TEMPERATURE1_KNOWN)
    one = Diagnostics()
    one.count(0, rows, np.arange(5))
    np.testing.assert_allclose(reported(one)["temperature_s"], [0.05, 0.1, 0.0, 0.0, 0.0, 0.05])


def test_residuals_at_the_nearest_torque_by_ratio():
    one = Diagnostics()
    for torque, residual in ((50.0, 2.0), (60.0, 4.0), (62.0, -1.0), (126.0, 8.0), (500.0, -3.0), (20.0, 99.0)):
        one.surprise(torque, residual)
    row = reported(one)
    np.testing.assert_allclose(row["residual_nm"], [3.0, -1.0, 8.0, np.nan, -3.0])
    np.testing.assert_allclose(row["residual_rms_nm"], [np.sqrt(10.0), 1.0, 8.0, np.nan, 3.0])


def test_drift_and_extremes():
    random = np.random.default_rng(7)
    way = np.sort(random.uniform(0.0, 500.0, 40))
    touch = 3.0 + 0.002 * way + 0.01 * random.standard_normal(40)
    one = Diagnostics()
    one.follow(np.nan, 1.0, 0.0)
    for km, point in zip(way, touch, strict=True):
        one.follow(float(point), 1.0 - km / 1000.0, float(km))
    row = reported(one)
    assert row["touch_per_1000_km"] == pytest.approx(1000.0 * np.polyfit(way, touch, 1)[0])
    assert (row["touch_first"], row["touch_least"], row["touch_most"]) == (touch[0], touch.min(), touch.max())
    assert row["friction_least"] == pytest.approx(1.0 - way[-1] / 1000.0)


def test_no_drift_over_a_short_way():
    one = Diagnostics()
    for km in (0.0, 1.0, 2.0):
        one.follow(3.0 + km, 1.0, km)
    assert np.isnan(one.touch_per_1000_km)


def test_heat_stands_for_a_temperature_that_is_not_known():
    warmth = Warmth()
    assert warmth.at(0, 1_000.0, np.nan) == 0.0  # work of before
    assert warmth.at(1_000_000, 51_000.0, np.nan) == pytest.approx(0.5)
    assert warmth.now(1_000_000 + int(COOLING_S * 1e6), np.nan) == pytest.approx(0.5 / np.e)
    assert warmth.now(2_000_000, 150.0) == 1.5
    assert warmth.at(3_000_000, 0.0, np.nan) < 0.5  # an estimator begun anew
