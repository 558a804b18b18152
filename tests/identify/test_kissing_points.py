"""Kissing points, put together from several drives and what was believed."""

import pytest

from dctorque_can.config.load import Config
from dctorque_can.evidence.clutches import kissing_point
from dctorque_can.evidence.moments import Moments
from dctorque_can.identify.kissing_points import kissing_points, together
from dctorque_can.identify.regression import Belief


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


def test_they_are_those_of_check(owned_drive: Moments, owned_truth: Config) -> None:
    """Launches are with clutch 1, so of clutch 2 the drive says nothing."""
    first, second = kissing_points([owned_drive], owned_truth)
    actuation = owned_truth.settings.phases.clutches[0]
    measured = kissing_point(owned_drive, 1, actuation.closes_increasing)
    assert measured is not None
    assert first.key == "clutch_phase.clutch1.kissing_point"
    assert first.unit == "mm"
    assert first.after == together(first.before, [Belief(measured.point.value, measured.point.sigma)])
    assert abs(first.after.value - actuation.threshold) < 3.0 * first.after.sigma
    assert first.told > 0.5
    assert second.after == second.before
