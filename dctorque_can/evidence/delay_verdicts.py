"""What the speeds say of each other's delays.

All delays are relative: the same added to each of them is the same file. So one that would have to be negative
becomes zero, and all others grow.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import chain

import numpy as np

from dctorque_can.evidence.delays import Delay, delays
from dctorque_can.evidence.draft import Draft, Fix
from dctorque_can.evidence.findings import Finding
from dctorque_can.evidence.fits import Number
from dctorque_can.evidence.moments import Moments
from dctorque_can.evidence.pictures import against, thinned
from dctorque_can.pipeline.samples import Quantity

LEAST_S = 2e-3
"""A difference below is no matter: half a period of the fastest bus."""
MOST_MS = 200.0
"""The most that a delay can be told as."""


def late_signals(m: Moments, draft: Draft) -> list[Finding]:
    """Return the speeds that come sooner or later than the file says, against most of the others."""
    honest = draft.config.settings.kalman.timing_error_s
    late = [
        each
        for each in delays(m)
        if abs(each.late_s.value) >= LEAST_S and each.late_s.is_off(0.0, float(np.hypot(honest, each.model_s)))
    ]
    told_ms = {given.quantity: 1e-3 * given.delay_us for given in draft.config.inputs}
    wrong = {quantity: each for each in late for quantity in each.quantities}
    right_ms = told_ms | {
        quantity: told_ms[quantity] + 1e3 * each.late_s.value for quantity, each in wrong.items()
    }
    first = min(right_ms, key=lambda quantity: right_ms[quantity])
    shift_ms = max(0.0, -right_ms[first])
    right_ms = {quantity: round(right + shift_ms, 1) for quantity, right in right_ms.items()}
    others = _set(draft, [quantity for quantity in told_ms if quantity not in wrong], right_ms)
    can_be = max(right_ms.values()) <= MOST_MS
    found = []
    for each in late:
        fix = _set(draft, each.quantities, right_ms)
        also = others if shift_ms and first in each.quantities else ()
        one = _finding(draft, each, told_ms[each.quantities[0]], right_ms[each.quantities[0]], fix, also)
        found.append(one if can_be else replace(one, fix=(), also=()))
    return found


def _set(draft: Draft, quantities: Iterable[Quantity], right_ms: Mapping[Quantity, float]) -> Fix:
    keys = (draft.with_key(quantity, "delay_ms", f"{right_ms[quantity]:g}") for quantity in quantities)
    return tuple(chain.from_iterable(keys))


def _finding(draft: Draft, late: Delay, told_ms: float, right_ms: float, fix: Fix, also: Fix) -> Finding:
    names = ", ".join(draft.key_of(quantity).removeprefix("inputs.") for quantity in late.quantities)
    sigma_ms = 1e3 * float(np.hypot(late.late_s.sigma, late.model_s))
    by = Number(1e3 * abs(late.late_s.value), sigma_ms, late.late_s.seconds)
    when = "later" if late.late_s.value > 0.0 else "sooner"
    text = f"{names}: comes {by.shown('ms')} {when} than delay_ms = {told_ms:g} says, against most other speeds"
    if also:
        text += "; no delay is negative, so those of all others grow"
    key = f"{draft.key_of(late.quantities[0])}.delay_ms"
    picture = against(
        ("rate of the speed, rad/s²", "by how much it lags behind, rad/s"),
        thinned(late.rate, late.lag),
        {
            f"the file: delay_ms = {told_ms:g} fits": lambda x: 0.0 * x,
            f"the log: {by.shown('ms')} {when}": lambda x: late.late_s.value * x,
        },
    )
    return Finding("warning", key, text, right_ms, sigma_ms, fix, picture=picture, also=also)
