"""How late all messages are together.

Recordings tell delays by their differences alone. What is left is one number, by which all are later. A delay that
nobody tells is positive, and what is believed of it is hardly more than its mean: the distribution that assumes no
more is the exponential one (Jaynes, Physical Review 106, 1957, 620). A normal one would take a signal that comes
with its cause for as unlikely as one that comes twice too late.

Messages of one control unit are late alike, so each unit counts once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dctorque_can.evidence.moments import SHAFTS, WHEELS
from dctorque_can.identify.beliefs import LATE, WHEELS_LATE, Message
from dctorque_can.identify.regression import Posterior
from dctorque_can.identify.unknowns import late_name

_UNTOLD = (LATE, WHEELS_LATE)
_LATEST_S, _STEPS = 0.1, 4001


def with_common_delay(found: Posterior, messages: Sequence[Message], values: Mapping[str, float]) -> Posterior:
    """Return a posterior in which all delays together are as likely as delays are.

    Args:
        found: with normal beliefs; what delays are to be corrected by.
        messages: whose delays these are.
        values: of the delays, which are corrected, s.
    """
    known = [each for each in messages if late_name(each) in found.names]
    untold: dict[str, list[tuple[float, float]]] = {}
    for each in known:
        if each.late in _UNTOLD:
            late_s = values[late_name(each)] + found.of(late_name(each)).value
            untold.setdefault(_unit(each), []).append((late_s, each.late.value / 1000.0))
    if not untold:
        return found
    units = [tuple(np.mean(pairs, axis=0)) for pairs in untold.values()]
    shift = np.linspace(0.0, _LATEST_S, _STEPS) - min(late_s for late_s, _ in units)
    cost = shift * sum(1.0 / mean_s for _, mean_s in units)
    for each in known:
        if each.late not in _UNTOLD:
            late_s = values[late_name(each)] + found.of(late_name(each)).value
            off = (shift + late_s - each.late.value / 1000.0) / max(each.late.sigma / 1000.0, 1e-6)
            cost += 0.5 * off**2
    weight = np.exp(np.min(cost) - cost)
    weight /= weight.sum()
    middle = float(weight @ shift)
    variance = float(weight @ (shift - middle) ** 2)
    rows = [found.names.index(late_name(each)) for each in known]
    covariance, corrections = found.covariance.copy(), found.values.copy()
    block = np.ix_(rows, rows)
    was = 1.0 / float(np.linalg.inv(covariance[block]).sum())
    covariance[block] += variance - was
    corrections[rows] += middle
    return replace(found, values=corrections, covariance=covariance)


def _unit(message: Message) -> str:
    """Return which control unit sends a message."""
    if set(message.quantities) & set(WHEELS):
        return "brakes"
    return "transmission" if set(message.quantities) & set(SHAFTS) else "engine"
