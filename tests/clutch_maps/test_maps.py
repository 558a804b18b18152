"""Both maps as a whole: batches, published rows, what is kept."""

import json
from itertools import pairwise

import numpy as np
import pytest

from dctorque_can.clutch_maps.maps import ClutchMaps
from dctorque_can.clutch_maps.rows import CLUTCH_MAP
from dctorque_can.clutch_maps.state import BadStateError, begin_from, kept
from dctorque_can.clutch_maps.summary import maps_json

from .car import TOUCH_MM, capacity, rows_of, samples_of, settings

SECOND = 1_000_000


@pytest.fixture(scope="module")
def drive():
    """Sixty seconds of a slipping clutch whose position goes up and down."""
    t = np.arange(0, 60 * SECOND, 10_000)
    x = 5.2 + 1.9 * np.sin(2e-6 * np.pi * t / 4.0)
    random = np.random.default_rng(8)
    torque = capacity(x) + 3.0 * random.standard_normal(len(t))
    rows = rows_of(t, torque, clutch1_engagements=t // (4 * SECOND), clutch1_energy_j=2000.0)
    return samples_of(t, x), rows


def fed(drive, cuts, rules=None):
    samples, rows = drive
    maps = ClutchMaps(rules or settings())
    parts = [maps.take(samples[slice(a, b)], rows[a:b]) for a, b in pairwise(cuts)]
    return maps, np.concatenate(parts)


def same(one, other):
    for name in CLUTCH_MAP.names:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_it_finds_the_clutch(drive):
    maps, rows = fed(drive, [0, len(drive[1])])
    last = maps.now()[0]
    valid = last["valid"] == 1
    error = (last["capacity_nm"] - capacity(last["actuation"]))[valid]
    assert valid.sum() > 8
    assert np.sqrt(np.mean(error**2)) < 0.02 * 170.0
    assert last["touch_valid"]
    assert last["touch_point"] == pytest.approx(TOUCH_MM, abs=2.0 * last["touch_sigma"])
    assert last["engagements"].tolist() == [0, 14, 0, 0, 0]
    assert last["distance_km"] == pytest.approx(0.06 * 3.0, rel=0.01)
    assert rows["clutch"].tolist() == [1, 2] * 59  # 1.05 s, 2.05 s, … after a first window that ends at 0.05 s
    assert set(np.diff(rows["t_us"][::2])) == {SECOND}


def test_batches_change_nothing(drive):
    n = len(drive[1])
    whole, expected = fed(drive, [0, n])
    for step in (7, 501):
        cuts = [*range(0, n, step), n]
        maps, rows = fed(drive, cuts)
        same(rows, expected)
        same(maps.now(), whole.now())


def test_what_is_kept_goes_on_as_if_nothing_had_been(drive):
    """Through JSON and back: the same maps, but for a rest of unknown length, which makes them less sure."""
    maps, _ = fed(drive, [0, len(drive[1])])
    before = maps.now()
    again = ClutchMaps(settings())
    begin_from(again, json.loads(json.dumps(kept(maps), allow_nan=False)))
    assert len(again.now()) == 0  # no window yet
    samples, rows = drive
    again.take(samples[slice(0, 400)], rows[:400])
    after = again.now()
    assert after["restored"].tolist() == [1, 1]
    valid = (before["valid"][0] == 1) & (after["valid"][0] == 1)
    assert valid.sum() > 8
    np.testing.assert_allclose(
        after["capacity_nm"][0][valid], before["capacity_nm"][0][valid], rtol=0.03, atol=2.0
    )
    assert after["taken"][0] > before["taken"][0]
    assert after["distance_km"][0] > before["distance_km"][0]
    assert after["touch_first"][0] == before["touch_first"][0]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda state: state.pop("clutches"),
        lambda state: state["clutches"].pop("2"),
        lambda state: state["clutches"]["1"].update(x=[0.0]),
        lambda state: state["clutches"]["1"].update(span=-1.0),
        lambda state: state["clutches"]["1"]["x"].__setitem__(3, float("nan")),
        lambda state: state["clutches"]["1"]["P"][0].__setitem__(0, -1.0),
        lambda state: state["clutches"]["1"].update(seen=None),
        lambda state: state["clutches"]["1"].update(taken="many"),
        lambda state: state.update(distance_km=1e300),
    ],
)
def test_a_state_that_no_map_can_have_is_refused(drive, spoil):
    maps, _ = fed(drive, [0, 500])
    state = json.loads(json.dumps(kept(maps)))
    spoil(state)
    with pytest.raises(BadStateError):
        begin_from(ClutchMaps(settings()), state)


def test_one_clutch_of_which_nothing_is_told_has_no_map(drive):
    one = settings(clutches=(settings().clutches[0], None))
    maps, rows = fed(drive, [0, len(drive[1])], one)
    assert set(rows["clutch"]) == {1}
    assert len(maps.now()) == 1
    assert len(ClutchMaps(settings(clutches=(None, None))).now()) == 0


def test_json_has_no_numbers_that_are_none(drive):
    maps, _ = fed(drive, [0, len(drive[1])])
    first, second = maps_json(maps.now())
    json.dumps([first, second], allow_nan=False)
    assert first["clutch"] == 1
    assert second["touch_point"] is None
    assert second["nodes"] == []
    assert sum(node["valid"] for node in first["nodes"]) == maps.now()["valid"][0].sum()
    assert first["engagements"][1] == {"from": 1e3, "to": 5e3, "value": 14}
