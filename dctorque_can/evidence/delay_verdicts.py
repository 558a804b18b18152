"""What the speeds say of each other's delays."""

from __future__ import annotations

import numpy as np

from dctorque_can.evidence.delays import delays
from dctorque_can.evidence.draft import Draft, Fix
from dctorque_can.evidence.findings import Finding
from dctorque_can.evidence.fits import Number
from dctorque_can.evidence.moments import Moments

LEAST_S = 2e-3
"""A difference below is no matter: half a period of the fastest bus."""
MOST_MS = 200.0
"""The most that a delay can be told as."""


def late_signals(m: Moments, draft: Draft) -> list[Finding]:
    """Return the speeds that come sooner or later than the file says, against most of the others."""
    found = []
    honest = draft.config.settings.kalman.timing_error_s
    for each in delays(m):
        late = each.late_s
        if abs(late.value) < LEAST_S or not late.is_off(0.0, float(np.hypot(honest, each.model_s))):
            continue
        told_us = {given.quantity: given.delay_us for given in draft.config.inputs}
        fix: Fix = ()
        for quantity in each.quantities:
            right_ms = 1e-3 * told_us[quantity] + 1e3 * late.value
            if not 0.0 <= right_ms <= MOST_MS:
                fix = ()
                break
            fix += draft.with_key(quantity, "delay_ms", f"{round(right_ms, 1):g}")
        names = ", ".join(draft.key_of(quantity).removeprefix("inputs.") for quantity in each.quantities)
        late_ms = Number(1e3 * abs(late.value), 1e3 * float(np.hypot(late.sigma, each.model_s)), late.seconds)
        told_ms = 1e-3 * told_us[each.quantities[0]]
        when = "later" if late.value > 0.0 else "sooner"
        than = f"{when} than delay_ms = {told_ms:g} says, against most other speeds"
        text = f"{names}: comes {late_ms.shown('ms')} {than}"
        right = told_ms + 1e3 * late.value
        key = f"{draft.key_of(each.quantities[0])}.delay_ms"
        found.append(Finding("warning", key, text, right, late_ms.sigma, fix))
    return found
