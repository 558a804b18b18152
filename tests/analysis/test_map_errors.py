"""A map that is wrong by what is known."""

import numpy as np
import pytest

from dctorque_can.analysis.map_errors import map_errors
from dctorque_can.clutch_maps.rows import CLUTCH_MAP
from dctorque_can.simulation.truth import TRUTH


def truth(n=1000):
    rows = np.zeros(n, TRUTH)
    rows["t_us"] = 1000 * np.arange(n)
    rows["clutch1_position_mm"] = np.linspace(3.0, 7.0, n)
    rows["clutch1_capacity_nm"] = 20.0 * (rows["clutch1_position_mm"] - 3.0)
    rows["phase1"] = 1
    rows["engine_torque_nm"][500] = 160.0
    return rows


def maps(times, offsets, sigma=3.0):
    rows = np.zeros(len(times), CLUTCH_MAP)
    rows["t_us"], rows["clutch"] = times, 1
    rows["actuation"] = np.linspace(3.0, 7.0, rows["actuation"].shape[1])
    rows["capacity_nm"] = 20.0 * (rows["actuation"] - 3.0) + np.array(offsets)[:, None]
    rows["sigma_nm"], rows["valid"] = sigma, 1
    return rows


def test_each_map_is_held_against_the_time_after_it():
    found = map_errors(maps([0, 500_000], [4.0, -8.0]), truth(), 1, truth()["clutch1_position_mm"])
    assert found.milliseconds == 1000
    assert found.rms_nm == pytest.approx(np.sqrt((16.0 + 64.0) / 2.0))
    assert found.rms_share == pytest.approx(found.rms_nm / 160.0)
    assert found.bias_nm == pytest.approx(-2.0)
    assert found.worst_nm == pytest.approx(-8.0)
    assert found.covered == pytest.approx(0.5)


def test_only_where_it_slips_and_both_nodes_are_valid():
    rows, real = maps([0], [5.0]), truth()
    real["phase1"][:250] = 2
    rows["valid"][0, 12:] = 0
    found = map_errors(rows, real, 1, real["clutch1_position_mm"])
    assert found.milliseconds == np.sum((real["clutch1_position_mm"] <= rows["actuation"][0, 11])[250:])
    rows["valid"] = 0
    assert map_errors(rows, real, 1, real["clutch1_position_mm"]) is None
    assert map_errors(rows, real, 2, real["clutch2_position_mm"]) is None


def test_the_unit_is_that_of_the_bus():
    """A position in %, that closes downwards."""
    real = truth()
    percent = 100.0 - 10.0 * real["clutch1_position_mm"]
    rows = maps([0], [5.0])
    rows["actuation"] = 100.0 - 10.0 * rows["actuation"]
    found = map_errors(rows, real, 1, percent)
    assert found.milliseconds == 1000
    assert found.rms_nm == pytest.approx(5.0)
    percent[:300] = np.nan
    assert map_errors(rows, real, 1, percent).milliseconds == 700
