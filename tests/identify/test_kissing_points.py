"""Kissing points, put together from several drives and what was believed."""

import pytest

from dctorque_can.config.load import Config, load_documents
from dctorque_can.evidence.clutch_verdicts import HONEST_WAY
from dctorque_can.evidence.clutches import kissing_point, told
from dctorque_can.evidence.moments import Moments
from dctorque_can.identify.kissing_points import kissing_points, together
from dctorque_can.identify.regression import Belief

KEY = "clutch_phase.clutch1"


def test_what_agrees_gets_surer() -> None:
    found = together(Belief(5.0, 1e6), [Belief(3.0, 0.2), Belief(3.0, 0.2), Belief(3.0, 0.2), Belief(3.0, 0.2)])
    assert found.value == pytest.approx(3.0)
    assert found.sigma == pytest.approx(0.1)


def test_what_differs_does_not() -> None:
    """Two measurements that are 4 σ/√2 apart: χ² is 8, so σ grows by √8."""
    found = together(Belief(0.0, 1e6), [Belief(1.0, 0.1), Belief(1.4, 0.1)])
    assert found.value == pytest.approx(1.2)
    assert found.sigma == pytest.approx(0.1 / 2.0**0.5 * 8.0**0.5)


def test_a_belief_counts_by_its_sigma() -> None:
    found = together(Belief(2.0, 0.3), [Belief(3.0, 0.3)])
    assert found.value == pytest.approx(2.5)


def test_an_error_that_all_have_stays() -> None:
    found = together(Belief(0.0, 1e6), [Belief(3.0, 0.1)] * 100, honest=0.4)
    assert found.value == pytest.approx(3.0)
    assert found.sigma == pytest.approx(0.4, rel=0.01)


def test_they_are_those_of_check(owned_drive: Moments, owned_truth: Config) -> None:
    """Launches are with clutch 1, so of clutch 2 the drive says nothing."""
    first, second = kissing_points([owned_drive], owned_truth)
    actuation = owned_truth.settings.phases.clutches[0]
    measured, seen = kissing_point(owned_drive, 1, actuation.closes_increasing), told(owned_drive, 1)
    assert measured is not None
    assert seen is not None
    assert first.key == "clutch_phase.clutch1.kissing_point"
    assert first.unit == "mm"
    assert first.after.value == pytest.approx(measured.point.value, abs=0.5 * HONEST_WAY * abs(seen.way))
    assert first.after.sigma > 0.8 * measured.point.sigma
    assert abs(first.after.value - actuation.threshold) < 2.0 * first.after.sigma
    assert first.told > 0.5
    assert second.after == second.before


def test_a_clutch_that_waits_counts_as_open(owned_drive: Moments, owned_truth: Config) -> None:
    """With a wide hysteresis it would never open again, were the kissing point where it is measured."""
    actuation, seen = owned_truth.settings.phases.clutches[0], told(owned_drive, 1)
    assert seen is not None
    assert not actuation.closes_increasing
    width = 2.2 * (seen.other_holds - actuation.threshold)
    first, _ = kissing_points(
        [owned_drive], load_documents(owned_truth.documents, {f"{KEY}.hysteresis": str(width)})
    )
    assert first.after.value + 0.5 * width < seen.other_holds
