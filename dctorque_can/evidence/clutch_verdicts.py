"""What the speeds say of the signals of the clutches, and what would be right."""

from __future__ import annotations

import numpy as np

from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.evidence.clutches import Kiss, Told, holding, kissing_point, signal, told
from dctorque_can.evidence.draft import Draft, Fix, number
from dctorque_can.evidence.findings import Finding, Picture
from dctorque_can.evidence.moments import Moments
from dctorque_can.evidence.pictures import against, thinned

HONEST_WAY = 0.1
"""Standard deviation of a kissing point on a right file, as a share of the way from open to closed: wear."""
_SIGNALS = frozenset(
    {"clutches_exchanged", "clutch_direction", "launch_called_open"}
    | {f"clutch{i}_called_{how}" for i in (1, 2) for how in ("open", "closed")}
)


def directions(m: Moments, draft: Draft) -> list[Finding]:
    """Return whether the signals of the clutches are exchanged, or say closed for open."""
    actuations = draft.config.settings.phases.clutches
    seen = [told(m, clutch) for clutch in (1, 2)]
    wrong: list[bool | None] = []
    for actuation, each in zip(actuations, seen, strict=True):
        if each is None or abs(each.way) < 3.0 * each.scatter:
            wrong.append(None)
            continue
        rises = actuation.closes_increasing or actuation.source is not PhaseSource.POSITION
        wrong.append((each.way > 0.0) != rises)
    if wrong == [True, True] and all(each is not None and _rests_as_if_other(each) for each in seen):
        return [_exchanged(m, draft)]
    return [_direction(m, draft, i + 1) for i in range(2) if wrong[i]]


def kissing_points(m: Moments, draft: Draft) -> list[Finding]:
    """Return the kissing points that are not where the file has them."""
    found = []
    for clutch in (1, 2):
        actuation = draft.config.settings.phases.clutches[clutch - 1]
        if actuation.source is not PhaseSource.POSITION:
            continue
        seen = told(m, clutch)
        kiss = kissing_point(m, clutch, actuation.closes_increasing)
        if seen is None or kiss is None:
            continue
        honest = float(np.hypot(HONEST_WAY * abs(seen.way), 0.5 * actuation.hysteresis))
        if not kiss.point.is_off(actuation.threshold, honest):
            continue
        key = f"clutch_phase.clutch{clutch}.kissing_point"
        text = f"clutch{clutch}: kissing point {kiss.point.shown()} instead of {actuation.threshold:g}"
        fix = ((key, number(kiss.point.value, 3)),)
        explains = {f"clutch{clutch}_called_open", f"clutch{clutch}_called_closed", "launch_called_open"}
        picture = _kiss_picture(kiss, clutch, actuation.threshold)
        sigma = kiss.point.sigma
        found.append(Finding("error", key, text, kiss.point.value, sigma, fix, frozenset(explains), picture))
    return found


def _rests_as_if_other(seen: Told) -> bool:
    """Return whether a signal at rest, with both clutches open, is as while its own clutch is said to hold."""
    return seen.rests is not None and abs(seen.rests - seen.holds) < abs(seen.rests - seen.other_holds)


def _exchanged(m: Moments, draft: Draft) -> Finding:
    first, second = "clutch_phase.clutch1", "clutch_phase.clutch2"
    text = (
        "the signals of clutch1 and clutch2 are exchanged: each says closed while the other clutch holds the "
        "engine, and open at rest"
    )
    fix = draft.exchanged(first, second)
    return Finding("error", first, text, None, None, fix, _SIGNALS, _hold_picture(m, 1))


def _direction(m: Moments, draft: Draft, clutch: int) -> Finding:
    actuation = draft.config.settings.phases.clutches[clutch - 1]
    key = f"clutch_phase.clutch{clutch}"
    fix: Fix = ()
    if actuation.source is PhaseSource.POSITION:
        right, other = (
            ("decreasing", "increasing") if actuation.closes_increasing else ("increasing", "decreasing")
        )
        text = f"clutch{clutch}: closes: {right} fits, {other} does not"
        kiss = kissing_point(m, clutch, not actuation.closes_increasing)
        fix = ((f"{key}.closes", right),)
        seen = told(m, clutch)
        if (
            kiss is not None
            and seen is not None
            and kiss.point.is_off(actuation.threshold, HONEST_WAY * abs(seen.way))
        ):
            text += f"; kissing point {kiss.point.shown()} instead of {actuation.threshold:g}"
            fix += ((f"{key}.kissing_point", number(kiss.point.value, 3)),)
        key += ".closes"
    elif actuation.source is PhaseSource.FLAG:
        text = (
            f"clutch{clutch}: the flag says open while the clutch holds the engine, and closed while it does not"
        )
        values = draft.value(f"{key}.values")
        if isinstance(values, dict):
            turned = {raw: "closed" if state == "open" else "open" for raw, state in values.items()}
            fix = ((f"{key}.values", "{" + ", ".join(f"{raw}: {state}" for raw, state in turned.items()) + "}"),)
    else:
        text = (
            f"clutch{clutch}: its command falls as it closes: look at its sign, and whether it is that of a clutch"
        )
    return Finding("error", key, text, None, None, fix, _SIGNALS, _hold_picture(m, clutch))


def _hold_picture(m: Moments, clutch: int) -> Picture:
    """Return what is told of a clutch over the time, while it holds and while the other one does."""
    values = signal(m, clutch)
    assert values is not None
    own, other = holding(m) if clutch == 1 else holding(m)[::-1]
    seen = told(m, clutch)
    lines = {}
    if seen is not None:
        lines = {
            f"clutch {clutch} holds: {seen.holds:.4g}": lambda x: 0.0 * x + seen.holds,
            f"the other one holds: {seen.other_holds:.4g}": lambda x: 0.0 * x + seen.other_holds,
        }
    return against(("time, s", f"signal of clutch {clutch}"), thinned(m.t_s, values, own | other), lines)


def _kiss_picture(kiss: Kiss, clutch: int, threshold: float) -> Picture:
    points = thinned(kiss.positions, kiss.torques)
    top = float(np.quantile(points[1], 0.98))
    level = np.array([0.0, top])
    lines = (
        (f"the file: {threshold:g}", np.full(2, threshold), level),
        (f"the log: {kiss.point.shown()}", np.full(2, kiss.point.value), level),
    )
    return Picture(f"position of clutch {clutch}", "engine torque that goes through it, N·m", *points, lines)
