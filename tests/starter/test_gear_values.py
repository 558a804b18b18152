"""What value tables and ratios say of gears."""

import numpy as np
import pytest

from dctorque_can.starter.gear_values import (
    between_gears,
    gear_of_text,
    gears_reached,
    numbered,
    ratio_by_value,
    without_reverse,
)


@pytest.mark.parametrize(
    ("text", "gear"),
    [
        *(
            ("Gang 1", 1),
            ("Gang_7", 7),
            ("1st", 1),
            ("Third", 3),
            ("zweiter Gang", 2),
            ("D4", 4),
            ("_10th_Gear", 10),
        ),
        *(("Neutral", 0), ("N", 0), ("P/N", 0), ("Leerlauf", 0), ("changing", 0), ("R", -1), ("Reverse", -1)),
        *(("Rückwärtsgang", -1), ("Fehler", None), ("not available", None), ("SNA", None), ("D", None)),
    ],
)
def test_texts_of_gears(text: str, gear: int | None) -> None:
    assert gear_of_text(text) == gear


def test_gears_are_numbered_from_the_lowest_one() -> None:
    assert numbered([6.5, 17.2, 10.3]) == [3, 1, 2]
    assert numbered([10.3, 3.4]) == []  # there must be one between
    assert numbered([6.5, 4.4, 3.4]) == []  # no car's lowest gear is so long
    assert numbered([17.2]) == []


def test_reverse_is_left_out() -> None:
    raw = np.repeat([7.0, 1.0, 2.0, 3.0, 2.0, 1.0, 7.0, 1.0, 2.0], 10)
    ratios = {7: 16.0, 1: 17.2, 2: 10.3, 3: 6.5}
    assert without_reverse(ratios, raw) == {1: 17.2, 2: 10.3, 3: 6.5}
    assert without_reverse({1: 17.2, 2: 10.3, 3: 6.5}, raw) == {1: 17.2, 2: 10.3, 3: 6.5}


def test_a_value_that_goes_with_every_ratio_is_no_gear() -> None:
    random = np.random.default_rng(3)
    raw = np.repeat([1.0, 2.0, 9.0], 200)
    ratio = np.concatenate([np.full(200, 17.0), np.full(200, 10.0), random.uniform(3.0, 17.0, 200)])
    found = ratio_by_value(raw, ratio, np.ones(600, np.bool_))
    assert dict(found.ratios) == pytest.approx({1: 17.0, 2: 10.0})
    assert not found.tells_gears  # a third of the time fits nothing


def test_a_target_leads_to_the_actual_gear() -> None:
    actual = np.repeat([1.0, 2.0, 3.0, 2.0, 1.0], 200)
    from_the_shift_on = np.roll(actual, -20)
    values, share = gears_reached(from_the_shift_on + 4.0, actual)
    assert {raw: gear for raw, gear in values.items() if gear > 1} == {6: 2, 7: 3}
    assert share == 1.0
    preselected = np.repeat([2.0, 3.0, 2.0, 1.0, 2.0], 200)
    values, share = gears_reached(preselected, actual)
    assert (values, share) == ({2: 2, 3: 3, 1: 1}, 1.0)


def test_what_comes_between_gears_is_neutral() -> None:
    raw = np.array([6, 6, 3, 8, 3, 6, 3, 10, np.nan, 10, 3, 3, 8, 15, 8, 3, 6], float)
    assert between_gears(raw, {6, 8, 10}) == 3
    assert between_gears(raw, {3, 6, 8, 10}) is None  # 15 came once
    assert between_gears(np.array([6.0, 8.0, 10.0, 8.0]), {6, 8, 10}) is None
