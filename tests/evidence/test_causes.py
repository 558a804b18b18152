"""Which scales are found, by comparisons that are made up."""

import numpy as np
import pytest

from dctorque_can.evidence.causes import Cause, Comparison, explain
from dctorque_can.evidence.fits import Number

GEARS = {1: 1, 2: 2, 3: 1, 4: 2}  # gear: shaft
CAUSES = [
    Cause("wheels", {"fl": 1, "fr": 1}, 0.008),
    Cause("engine", {"engine": 1}),
    Cause("shaft1", {"shaft1": 1}),
    Cause("shaft2", {"shaft2": 1}),
    Cause("shafts", {"shaft1": 1, "shaft2": 1}),
    Cause("fl", {"fl": 1}),
    *(Cause(f"gear {n}", {f"gear {n}": 1}) for n in GEARS),
]


def compared(**wrong):
    """Return all comparisons of a car in which some scales are wrong, each with a little noise."""
    random = np.random.default_rng(3)
    wrong = {name.replace("_", " "): value for name, value in wrong.items()}
    every = [{"fl": 1, "fr": -1}, {"engine": 1, "shaft1": -1}, {"engine": 1, "shaft2": -1}]
    every += [{f"shaft{i}": 1, f"gear {n}": -1, w: -1} for n, i in GEARS.items() for w in ("fl", "fr")]
    return [
        Comparison(
            parts,
            Number(sum(wrong.get(p, 0.0) * k for p, k in parts.items()) + random.normal(0, 1e-3), 1e-3, 10.0),
            0.0015,
        )
        for parts in every
    ]


@pytest.mark.parametrize(
    ("wrong", "names"),
    [
        ({}, []),
        ({"gear_3": 0.05}, ["gear 3"]),
        ({"engine": 0.693}, ["engine"]),
        ({"shaft1": -0.693}, ["shaft1"]),
        ({"shaft1": 2.26, "shaft2": 2.26}, ["shafts"]),
        ({"fl": 0.05, "fr": 0.05}, ["wheels"]),
        ({"fl": 0.03}, ["fl"]),
        ({"fl": 1.28, "fr": 1.28, "gear_2": 0.03}, ["wheels", "gear 2"]),
    ],
)
def test_the_fewest_causes(wrong, names):
    found = explain(compared(**wrong), CAUSES)
    assert [each.cause.name for each in found] == names
    for each in found:
        right = next(wrong[part.replace(" ", "_")] for part in each.cause.parts)
        assert abs(each.log.value - right) < 4.0 * each.log.sigma


def test_what_an_honest_file_may_have_is_no_cause():
    """A radius is known to 0.8 %: 2 % are two and a half of its standard deviations, 4 % are five."""
    assert explain(compared(fl=0.02, fr=0.02), CAUSES) == []
    assert [each.cause.name for each in explain(compared(fl=0.04, fr=0.04), CAUSES)] == ["wheels"]


def test_nothing_compared():
    assert explain([], CAUSES) == []
