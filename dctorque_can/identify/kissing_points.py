"""Where the clutches begin to carry torque, as `check --log` measures it (`evidence.clutches`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dctorque_can.config.load import Config
from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.evidence.clutch_verdicts import HONEST_WAY
from dctorque_can.evidence.clutches import beyond, kissing_point, told
from dctorque_can.evidence.fits import Number
from dctorque_can.evidence.moments import Moments
from dctorque_can.identify.regression import Belief
from dctorque_can.identify.results import Result
from dctorque_can.pipeline.samples import Quantity


def kissing_points(recordings: Sequence[Moments], config: Config) -> list[Result]:
    """Return the kissing points of clutches whose positions are told.

    What a measurement leaves out, how a clutch hardens above all, is alike in all drives; `check --log` allows as
    much. Where a clutch waits while the other one has all of the torque, it must count as open.

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
        seen = [each for m in recordings if (each := told(m, clutch)) is not None]
        after = before
        if points and before.sigma > 0.0:
            honest = HONEST_WAY * float(np.median([abs(each.way) for each in seen]))
            after = together(before, points, honest)
            sign = 1.0 if actuation.closes_increasing else -1.0
            waits = max(sign * each.other_holds for each in seen) + 0.5 * actuation.hysteresis
            further = beyond(Number(sign * after.value, after.sigma, 0.0), waits)
            after = Belief(sign * further.value, further.sigma)
        found.append(Result(key, "kissing_points", unit, before, after, refused=False))
    return found


def together(before: Belief, measured: Sequence[Belief], honest: float = 0.0) -> Belief:
    """Return what is known of a number by what was believed, and several measurements.

    Where these differ by more than each one is unsure, all are as much less sure (Birge, Physical Review 40, 1932,
    207).

    Args:
        before: what was believed.
        measured: at least one.
        honest: standard deviation of an error that all have in common.
    """
    weights = np.array([each.sigma**-2 for each in measured])
    values = np.array([each.value for each in measured])
    middle = float(weights @ values / weights.sum())
    excess = float(weights @ (values - middle) ** 2) / max(len(values) - 1, 1)
    weight = float(weights.sum()) / max(excess, 1.0)
    weight = 1.0 / (1.0 / weight + honest**2)
    certainty = before.sigma**-2 + weight
    return Belief((before.value * before.sigma**-2 + middle * weight) / certainty, certainty**-0.5)
