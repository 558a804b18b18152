"""Wheel speeds: four signals that run together, and which of them is which."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dctorque_can.config.units import Dimension
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.material import Material, open_verdict
from dctorque_can.starter.motion import Floats, Motion, ratio_pattern, share_together
from dctorque_can.starter.naming import Rule
from dctorque_can.starter.proposal import Candidate, Gap, Proposal, Verdict, chosen, gap
from dctorque_can.starter.words import Word, wheel_of

WHEELS = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}
RULE = Rule(
    Dimension.WHEEL,
    needs=[
        (frozenset({Word.SPEED, Word.WHEEL}), 1.5),
        (frozenset({Word.WHEEL, Word.BRAKE, Word.INTERVENTION}), 1.0),
    ],
    against=frozenset(
        {
            Word.STEERING,
            Word.TORQUE,
            Word.ACCELERATION,
            Word.PRESSURE,
            Word.TARGET,
            Word.DIRECTION,
            Word.RATE,
            Word.LIMIT,
            Word.FILTERED,
        }
    ),
    bits=(7, 64),
)
_TOGETHER, _MOSTLY = 0.04, 0.85  # wheels differ by curves and slip, and that seldom
_APART = "only"  # how that is said
_FAMILY = 0.25  # for each other wheel in the same message
_MOST_UNNAMED = 400  # live signals among which wheels are looked for by behaviour alone


def find_wheels(material: Material) -> tuple[list[Proposal | Gap], Motion | None]:
    """Return the wheel speeds, and how the car moved if the log shows it."""
    candidates = [c for c in material.candidates(RULE) if wheel_of(c.entry.signal.name)]
    positions = Counter(
        c.entry.message.name for c in candidates if c.verdict.says not in ("absent", "contradicts")
    )
    candidates = [
        replace(c, named=c.named + _FAMILY * min(positions[c.entry.message.name], 4)) for c in candidates
    ]
    first = {key: _best(candidates, key) for key in WHEELS}
    reference = _reference(material, [c.entry for c in first.values() if c is not None and open_verdict(c)])
    motion = Motion(reference) if reference is not None else None
    if motion is not None:
        candidates = [_judged(material, c, motion) for c in candidates]
    found: list[Proposal | Gap] = []
    for key, text in WHEELS.items():
        of_wheel = [c for c in candidates if wheel_of(c.entry.signal.name) == key]
        contradicted = any(c.clear and c.verdict.why.startswith(_APART) for c in of_wheel)
        proposal = chosen(
            f"inputs.wheel_speeds.{key}",
            of_wheel,
            with_log=material.recording is not None,
            at_most="likely" if contradicted else "sure",
        )
        needed = not any(isinstance(each, Proposal) for each in found) and key == "rr"
        found.append(
            proposal
            or gap(f"inputs.wheel_speeds.{key}", f"no {text} wheel speed was found", of_wheel, needed=needed)
        )
    if all(isinstance(each, Gap) for each in found):
        return _by_behaviour(material, found)
    return _without_a_log(material, found), motion


def _best(candidates: Sequence[Candidate], key: str) -> Candidate | None:
    of_wheel = [c for c in candidates if wheel_of(c.entry.signal.name) == key and c.merit > 0.0]
    return max(of_wheel, key=lambda c: c.merit, default=None)


def _reference(material: Material, entries: Sequence[Entry]) -> Floats | None:
    """Return the median wheel speed on the grid, in rad/s if units are told; None without any."""
    if material.recording is None or not entries:
        return None
    return _median([material.recording.on_grid(each) * (each.factor(Dimension.WHEEL) or 1.0) for each in entries])


def _median(columns: Sequence[Floats]) -> Floats:
    """Return the median of those that are known, at each time."""
    table = np.vstack(columns)
    known = np.isfinite(table).any(axis=0)
    result = np.full(table.shape[1], np.nan)
    result[known] = np.nanmedian(table[:, known], axis=0)
    return result


def _judged(material: Material, candidate: Candidate, motion: Motion) -> Candidate:
    if material.recording is None or not open_verdict(candidate):
        return candidate
    entry = candidate.entry
    speed = material.recording.on_grid(entry) * (entry.factor(Dimension.WHEEL) or 1.0)
    if not motion.drives:
        return replace(candidate, verdict=Verdict("nothing", "the car hardly moves in the log"))
    together = share_together(speed, motion.wheel, motion.moving, _TOGETHER)
    if together < _MOSTLY:
        why = f"{_APART} {together:.0%} of the driving with the other wheels"
        return replace(candidate, verdict=Verdict("contradicts", why))
    return replace(
        candidate, verdict=Verdict("agrees", f"the log: with the other wheels in {together:.0%} of the driving")
    )


def _without_a_log(material: Material, found: Sequence[Proposal | Gap]) -> list[Proposal | Gap]:
    """Without a log only four clear names of one kind, and no other ones, are sure."""
    proposals = [each for each in found if isinstance(each, Proposal)]
    unmistakable = (
        len(proposals) == len(WHEELS)
        and not any(each.alternatives for each in proposals)
        and all(Word.WHEEL in each.entry.own and each.entry.unit for each in proposals)
        and len({(each.entry.unit, each.entry.layout.scale) for each in proposals}) == 1
    )
    if material.recording is not None:
        alone = len(proposals) == 1
        return [_lowered(each) if alone and isinstance(each, Proposal) else each for each in found]
    if not unmistakable:
        return list(found)
    why = "the DBC has these four and no other ones"
    return [
        replace(each, level="sure", why=(*each.why, why)) if isinstance(each, Proposal) else each for each in found
    ]


def _lowered(proposal: Proposal) -> Proposal:
    """Return a proposal that nothing could be compared with."""
    return (
        replace(proposal, level="likely", why=(*proposal.why, "no other wheel to compare with"))
        if proposal.level == "sure"
        else proposal
    )


def _by_behaviour(material: Material, gaps: list[Proposal | Gap]) -> tuple[list[Proposal | Gap], Motion | None]:
    """Return signals that run as wheels do, whatever they are called: guesses, in the order of the DBC."""
    recording = material.recording
    if recording is None:
        return gaps, None
    speeds = {
        id(e): (e, recording.on_grid(e))
        for e in material.entries
        if 8 <= e.layout.bits <= 32 and material.lives(e) and (not e.unit or e.factor(Dimension.WHEEL) is not None)
    }
    live = [each for each in speeds.values() if len(np.unique(each[1][np.isfinite(each[1])])) > 50][:_MOST_UNNAMED]
    best: list[Entry] = []
    merit = 0.0
    taken: set[int] = set()
    for entry, speed in live:
        if id(entry) in taken:
            continue
        motion = Motion(speed)
        if not motion.drives or not motion.stands:
            continue
        group = [e for e, other in live if share_together(speed, other, motion.moving, _TOGETHER) > _MOSTLY]
        taken |= {id(each) for each in group}
        patterns = [ratio_pattern(other, motion) for e, other in live if e not in group]
        geared = sum(p.lasting > 0.25 and len(p.levels) > 1 for p in patterns)
        worth = (len(group) == len(WHEELS)) * 2.0 + len(group) + geared
        if len(group) > 1 and geared and worth > merit:
            best, merit = group, worth
    if not best:
        return gaps, None
    motion = Motion(_median([recording.on_grid(each) for each in best]))
    if len(best) != len(WHEELS):
        names = ", ".join(each.name for each in best)
        return [
            replace(gap, why=f"these run together as wheels do, but no name says which is which: {names}")
            if isinstance(gap, Gap)
            else gap
            for gap in gaps
        ], motion
    why = (
        "the log: these four run together, stand with the car, and others go with them by gears",
        "which wheel is which is not known: in the order of the DBC",
    )
    return [
        Proposal(f"inputs.wheel_speeds.{key}", "guess", 0.5, why, entry)
        for key, entry in zip(WHEELS, best, strict=True)
    ], motion
