"""Torques: of the engine, net or as what burns less friction, and what the transmission says of its clutches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dctorque_can.config.units import Dimension, share_of
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.material import Material, open_verdict
from dctorque_can.starter.motion import Floats, Mask, Motion, correlation, slope
from dctorque_can.starter.naming import Rule
from dctorque_can.starter.proposal import Candidate, Gap, Proposal, Verdict, chosen, gap, ranked
from dctorque_can.starter.words import Word, number_of

_NOT_OF_AN_ENGINE = frozenset(
    {
        *(Word.STEERING, Word.WHEEL, Word.BRAKE, Word.ELECTRIC, Word.ACCESSORY, Word.PEDAL, Word.POSITION),
        *(Word.RATE, Word.LIMIT, Word.TARGET, Word.DRIVER, Word.DISPLAY, Word.INERTIA, Word.RATIO, Word.REFERENCE),
    }
)
ENGINE = Rule(
    Dimension.TORQUE,
    needs=[(frozenset({Word.TORQUE}), 1.5), (frozenset({Word.ENGINE}), 1.0)],
    likes=frozenset({Word.ACTUAL, Word.NET}),
    against=_NOT_OF_AN_ENGINE
    | {Word.CLUTCH, Word.GEARBOX, Word.INTERVENTION, Word.FRICTION, Word.FILTERED, Word.IDLE, Word.SPEED},
)
FRICTION = Rule(
    Dimension.TORQUE,
    needs=[
        (frozenset({Word.FRICTION}), 2.0),
        (frozenset({Word.TORQUE, Word.FRICTION}), 0.5),
        (frozenset({Word.ENGINE}), 0.5),
    ],
    against=_NOT_OF_AN_ENGINE | {Word.CLUTCH, Word.GEARBOX},
)
REFERENCE = Rule(
    Dimension.TORQUE,
    needs=[
        (frozenset({Word.REFERENCE, Word.LIMIT}), 1.0),
        (frozenset({Word.TORQUE}), 1.0),
        (frozenset({Word.ENGINE}), 0.5),
    ],
    likes=frozenset({Word.REFERENCE}),
    against=(_NOT_OF_AN_ENGINE - {Word.REFERENCE, Word.LIMIT}) | {Word.CLUTCH},
    bits=(5, 32),
)
TRANSMISSION = Rule(
    Dimension.TORQUE,
    needs=[(frozenset({Word.CLUTCH, Word.INPUT, Word.GEARBOX}), 1.5), (frozenset({Word.TORQUE}), 1.5)],
    likes=frozenset({Word.ACTUAL, Word.CLUTCH}),
    against=_NOT_OF_AN_ENGINE | {Word.INTERVENTION, Word.FRICTION, Word.OUTPUT},
)
COMMAND = Rule(
    Dimension.TORQUE,
    needs=[(frozenset({Word.CLUTCH}), 2.0), (frozenset({Word.TORQUE, Word.CLUTCH}), 1.0)],
    likes=frozenset({Word.TARGET}),
    against=(_NOT_OF_AN_ENGINE - {Word.TARGET}) | {Word.FRICTION},
)
_PUSHES, _HARDLY, _FEWEST = 0.55, 0.15, 100
_INERTIA_KGM2 = (25.0, 700.0)
"""Mass times radius squared of road vehicles, 300 to 7000 kg on wheels of 0.31 m: is a torque in N·m?"""
_IDLES = 0.06  # of the largest torque: as much as an idling engine gives to its own net torque
_STEADY_STEPS, _STEADY = 15, 0.012


@dataclass(frozen=True)
class Locked:
    """Where a clutch holds and the car drives, with the ratio of engine to wheels.

    Attributes:
        where: bool ``[n]``.
        ratio: float64 ``[n]``, total ratio as far as the unit of the wheels is known.
    """

    where: Mask
    ratio: Floats

    @classmethod
    def of(cls, engine_speed: Floats, motion: Motion) -> Locked:
        """Return where the ratio of engine to wheels lasts."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(motion.moving & (engine_speed > 0.0), engine_speed / motion.wheel, np.nan)
            changes = np.abs(np.log(ratio) - np.log(np.roll(ratio, _STEADY_STEPS)))
            changes[:_STEADY_STEPS] = np.nan
            return cls(changes < _STEADY, ratio)


def pushes(torque: Floats, locked: Locked, motion: Motion) -> tuple[float, float]:
    """Return how well a torque explains the acceleration of the wheels, and the m·r² that follows.

    Newton's law with a clutch that holds: J·dω/dt = i·T − load, the load a constant and a part with ω². Only where
    the torque drives: a brake is no torque of the engine.

    Args:
        torque: on the grid, any unit.
        locked: where a clutch holds.
        motion: of the wheels, rad/s.

    Returns:
        Correlation of the acceleration with what the torque explains, with its sign; J in that unit per rad/s².
    """
    smooth = _smoothed(torque)
    known = torque[np.isfinite(torque)]
    drives = 0.1 * float(np.percentile(known, 95)) if len(known) else np.inf
    with np.errstate(invalid="ignore"):
        use = locked.where & (smooth > max(drives, 0.0)) & np.isfinite(motion.acceleration * locked.ratio)
    if use.sum() < _FEWEST:
        return 0.0, np.nan
    force = smooth[use] * locked.ratio[use]
    others = np.column_stack([np.ones(use.sum()), motion.wheel[use] ** 2])
    y = motion.acceleration[use]
    rest_y = y - others @ np.linalg.lstsq(others, y, rcond=None)[0]
    rest_force = force - others @ np.linalg.lstsq(others, force, rcond=None)[0]
    if rest_force.std() < 1e-9 or rest_y.std() < 1e-9:
        return 0.0, np.nan
    gain = float(rest_force @ rest_y / (rest_force @ rest_force))
    return float(np.corrcoef(rest_force, rest_y)[0, 1]), 1.0 / gain if gain > 0.0 else np.nan


def _smoothed(values: Floats) -> Floats:
    """Return values over half a second, as the acceleration is: the slope of their integral."""
    known = np.nan_to_num(values)
    result = slope(np.cumsum(known) * 0.02)
    result[~np.isfinite(values)] = np.nan
    return result


def torque_on_grid(material: Material, entry: Entry) -> Floats:
    """Return a torque of the log on the grid, N·m, or in % of its reference, or without a unit as it is."""
    assert material.recording is not None
    return material.recording.on_grid(entry) * (entry.factor(Dimension.TORQUE) or 1.0)


def find_engine_torque(material: Material, motion: Motion | None, engine_speed: Floats | None) -> Proposal | Gap:
    """Return the net engine torque: a signal, or a sum of what burns and friction, perhaps times its reference."""
    key = "inputs.engine_torque"
    locked = Locked.of(engine_speed, motion) if engine_speed is not None and motion is not None else None
    judge = _judge_of(material, motion, locked)
    candidates = [_judged(c, judge) for c in material.candidates(ENGINE)]
    proposal = chosen(key, candidates, with_log=material.recording is not None)
    if proposal is None:
        return gap(key, "no engine torque was found, in N·m or %", candidates, needed=True)
    proposal = _with_friction(material, proposal, motion, engine_speed)
    return _with_reference(material, proposal)


def _judge_of(material: Material, motion: Motion | None, locked: Locked | None) -> Callable[[Entry], Verdict]:
    def judge(entry: Entry) -> Verdict:
        if material.recording is None:
            return Verdict("nothing")
        if motion is None or not motion.drives or locked is None or locked.where.sum() < _FEWEST:
            return Verdict("nothing", "the log shows no driving with a closed clutch to hold it against")
        explained, inertia = pushes(torque_on_grid(material, entry), locked, motion)
        if explained < _HARDLY:
            return Verdict(
                "contradicts", f"the log: the car does not accelerate with it (correlation {explained:.2f})"
            )
        says = f"the log: the car accelerates with it (correlation {explained:.2f})"
        if explained < _PUSHES:
            return Verdict("agrees", says, 0.5)
        absolute = entry.unit and share_of(entry.unit) is None
        if absolute and not _INERTIA_KGM2[0] < inertia < _INERTIA_KGM2[1]:
            return Verdict("agrees", f"{says}, but much too little or too much for N·m", 0.3)
        return Verdict("agrees", says)

    return judge


def _judged(candidate: Candidate, judge: Callable[[Entry], Verdict]) -> Candidate:
    return replace(candidate, verdict=judge(candidate.entry)) if open_verdict(candidate) else candidate


def _with_friction(
    material: Material, proposal: Proposal, motion: Motion | None, engine_speed: Floats | None
) -> Proposal:
    """Return the torque less friction where it is what burns: then it is not zero when the engine idles."""
    entry = proposal.entry
    same = [e for e in material.entries if e.unit == entry.unit and e.name != entry.name]
    friction = ranked(material.candidates(FRICTION, same))
    in_comment = Word.INDICATED in entry.comment and Word.NET not in entry.comment
    indicated = Word.INDICATED in entry.own or in_comment
    if not material.lives(entry) or motion is None or engine_speed is None:
        if not indicated:
            return proposal
        if not friction:
            return replace(proposal, level="guess", why=(*proposal.why, _INDICATED))
        return _sum(proposal, friction[0].entry, 1.0, "guess", ())
    torque = torque_on_grid(material, entry)
    with np.errstate(invalid="ignore"):
        idles = motion.resting & (engine_speed > 30.0) & np.isfinite(torque)
    largest = float(np.nanpercentile(np.abs(torque), 95))
    never_negative = float(np.nanmin(torque)) >= -0.01 * largest
    at_idle = float(np.median(torque[idles])) if idles.sum() > 25 else np.nan
    for candidate in friction:
        if not material.lives(candidate.entry):
            continue
        loss = torque_on_grid(material, candidate.entry)
        sign = -1.0 if float(np.nanmedian(loss)) < 0.0 else 1.0
        left = float(np.nanmedian(torque[idles] - sign * loss[idles])) if idles.sum() > 25 else np.nan
        if np.isfinite(left) and abs(left) < abs(at_idle) and abs(left) < 2.0 * _IDLES * largest:
            why = f"at idle {at_idle:.0f}, less friction {left:.0f}"
            level = proposal.level if candidate.clear else "likely"
            return _sum(proposal, candidate.entry, sign, level, (why,))
    if np.isfinite(at_idle) and at_idle > 2.0 * _IDLES * largest and never_negative:
        return replace(
            proposal, level="likely", why=(*proposal.why, f"{at_idle:.0f} at idle, never negative: {_INDICATED}")
        )
    if never_negative and proposal.level == "sure":
        return replace(
            proposal, level="likely", why=(*proposal.why, "never negative in the log: is it the net torque?")
        )
    if indicated and proposal.level == "sure":
        return replace(proposal, level="likely", why=(*proposal.why, _INDICATED))
    return proposal


_INDICATED = "this is what burns: the friction torque must be taken off, and no signal for it was found"


def _sum(proposal: Proposal, friction: Entry, sign: float, level: Any, why: tuple[str, ...]) -> Proposal:
    term: dict[str, Any] = {"signal": friction.name, "factor": -1} if sign > 0 else {"signal": friction.name}
    fields = {"sum": [{"signal": proposal.entry.name}, term]}
    text = f"less friction {friction.name}"
    return replace(proposal, level=level, fields=fields, why=(*proposal.why, text, *why), extra=(friction,))


def _with_reference(material: Material, proposal: Proposal) -> Proposal:
    """Return a torque in % with what 100 % are, where a signal tells it."""
    entry = proposal.entry
    if not entry.unit or share_of(entry.unit) is None:
        return proposal
    absolute = [e for e in material.entries if e.unit and share_of(e.unit) is None]
    found = []
    for candidate in material.candidates(REFERENCE, absolute):
        if candidate.verdict.says == "absent" or candidate.merit < -20.0:
            continue
        value = _usual(material, candidate.entry)
        of_the_moment = Word.REFERENCE not in candidate.entry.own and material.lives(candidate.entry)
        if (value is None or 30.0 <= value <= 3000.0) and not of_the_moment:
            found.append(
                replace(
                    candidate, verdict=Verdict("nothing", "" if value is None else f"{value:g} N·m in the log")
                )
            )
    order = ranked(found)
    if not order:
        why = "what 100 % are is not told by any signal: reference_nm is a gap"
        level: Any = "likely" if proposal.level == "sure" else proposal.level
        return replace(
            proposal, level=level, fields=proposal.fields | {"reference_nm": None}, why=(*proposal.why, why)
        )
    best = order[0].entry
    if Word.REFERENCE not in best.own and proposal.level == "sure":
        proposal = replace(
            proposal, level="likely", why=(*proposal.why, f"{best.name} is not clearly a reference")
        )
    value_text = f" ({order[0].verdict.why})" if order[0].verdict.why else ""
    return replace(
        proposal,
        fields=proposal.fields | {"times": {"signal": best.name}},
        why=(*proposal.why, f"100 % are {best.name}{value_text}"),
        extra=(*proposal.extra, best),
    )


def _usual(material: Material, entry: Entry) -> float | None:
    if material.recording is None or not material.recording.has(entry):
        return None
    values = torque_on_grid(material, entry)
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0


def find_transmission_torque(
    material: Material, motion: Motion | None, engine_speed: Floats | None, taken: set[str]
) -> Proposal | Gap:
    """Return the torque that the transmission believes of the clutch that drives."""
    locked = Locked.of(engine_speed, motion) if engine_speed is not None and motion is not None else None
    judge = _judge_of(material, motion, locked)
    entries = [e for e in material.entries if e.name not in taken and not _of_one_clutch(e)]
    candidates = [
        replace(judged, clear=judged.clear and Word.CLUTCH in judged.entry.own)
        for judged in (_judged(c, judge) for c in material.candidates(TRANSMISSION, entries))
        if Word.ENGINE not in judged.entry.own
    ]
    key = "inputs.transmission_torque"
    return chosen(key, candidates, with_log=material.recording is not None) or gap(
        key, "no clutch torque of the transmission was found", candidates
    )


def _of_one_clutch(entry: Entry) -> bool:
    return Word.CLUTCH in entry.own and number_of(entry.signal.name) != 0


def find_clutch_torques(material: Material, drives: Floats | None) -> list[Proposal]:
    """Return the torques of clutch 1 and 2 by name, if both are told; else nothing.

    Args:
        material: signals and log.
        drives: which clutch drives, 1 or 2, NaN where not known, on the grid; None where nothing tells.
    """
    found = []
    for n in (1, 2):
        among = [e for e in material.entries if number_of(e.signal.name) == n]
        candidates = [
            replace(c, verdict=clutch_verdict(material, c.entry, n, drives)) if open_verdict(c) else c
            for c in map(_commanded, material.candidates(COMMAND, among))
            if Word.TORQUE in c.entry.own or (c.entry.unit and share_of(c.entry.unit) is None)
        ]
        proposal = chosen(f"inputs.clutch{n}_command", candidates, with_log=material.recording is not None)
        if proposal is None or proposal.level == "guess":
            return []
        found.append(proposal)
    return found


def _commanded(candidate: Candidate) -> Candidate:
    """Return the candidate; what is not called a command may be what the transmission believes."""
    if Word.TARGET in candidate.entry.own:
        return candidate
    return replace(
        candidate, clear=False, why=(*candidate.why, "not called a command: is it one, or an estimate?")
    )


def clutch_verdict(material: Material, entry: Entry, n: int, drives: Floats | None) -> Verdict:
    """Return whether a signal is larger while clutch ``n`` drives than while the other one does, or smaller."""
    if material.recording is None:
        return Verdict("nothing")
    if drives is None:
        return Verdict("nothing", "the log does not show which clutch drives")
    values = material.recording.on_grid(entry)
    mine, other = values[(drives == n) & np.isfinite(values)], values[(drives == 3 - n) & np.isfinite(values)]
    if min(len(mine), len(other)) < _FEWEST:
        return Verdict("nothing", "the log shows only one of the clutches driving")
    apart = correlation(values, (drives == n).astype(np.float64), np.isfinite(drives))
    if abs(apart) < 0.5:
        return Verdict("contradicts", f"the log: the same whichever clutch drives (correlation {apart:.2f})")
    way = "larger" if apart > 0 else "smaller"
    return Verdict("agrees", f"the log: {way} while this clutch drives (correlation {apart:.2f})")
