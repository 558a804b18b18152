"""Where the clutches begin to carry torque, as `check --log` measures it (`evidence.clutches`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dctorque_can.config.load import Config
from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.evidence.clutches import kissing_point
from dctorque_can.evidence.moments import Moments
from dctorque_can.identify.regression import Belief
from dctorque_can.identify.results import Result
from dctorque_can.pipeline.samples import Quantity


def kissing_points(recordings: Sequence[Moments], config: Config) -> list[Result]:
    """Return the kissing points of clutches whose positions are told.

    Args:
        recordings: of drives, each of which measures them anew.
        config: the vehicle file. Without a standard deviation, one is as unsure as its ``kissing_point_error``.
    """
    found = []
    for clutch, actuation in enumerate(config.settings.phases.clutches, 1):
        if actuation.source is not PhaseSource.POSITION:
            continue
        key = f"clutch_phase.clutch{clutch}.kissing_point"
        quantity = Quantity(Quantity.CLUTCH1_POSITION + clutch - 1)
        unit = next(entry.units[0] for entry in config.entries if entry.input.quantity is quantity)
        before = Belief(actuation.threshold, config.sigmas.get(key, actuation.touches_before))
        kisses = [kissing_point(m, clutch, actuation.closes_increasing) for m in recordings]
        points = [Belief(each.point.value, each.point.sigma) for each in kisses if each is not None]
        after = together(before, points) if points and before.sigma > 0.0 else before
        found.append(Result(key, "kissing_points", unit, before, after, refused=False))
    return found


def together(before: Belief, measured: Sequence[Belief]) -> Belief:
    """Return what is known of a number by what was believed, and several measurements.

    Where these differ by more than each one is unsure, all are as much less sure (Birge, Physical Review 40, 1932,
    207).
    """
    weights = np.array([each.sigma**-2 for each in measured])
    values = np.array([each.value for each in measured])
    middle = float(weights @ values / weights.sum())
    excess = float(weights @ (values - middle) ** 2) / max(len(values) - 1, 1)
    weight = float(weights.sum()) / max(excess, 1.0)
    certainty = before.sigma**-2 + weight
    return Belief((before.value * before.sigma**-2 + middle * weight) / certainty, certainty**-0.5)
