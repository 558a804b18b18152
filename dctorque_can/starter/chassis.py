"""Brake, acceleration, grade and direction of the car."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dctorque_can.config.units import Dimension
from dctorque_can.driveline.parameters import STANDARD_GRAVITY
from dctorque_can.starter.catalogue import NOMINAL_RADIUS_M, Entry
from dctorque_can.starter.material import Material, open_verdict
from dctorque_can.starter.motion import STEP_S, Floats, Motion, correlation
from dctorque_can.starter.naming import Rule
from dctorque_can.starter.proposal import Candidate, Gap, Proposal, Verdict, chosen, gap
from dctorque_can.starter.words import Word, plain, wheel_of

BRAKE = Rule(
    Dimension.AS_IS,
    needs=[(frozenset({Word.BRAKE}), 2.0)],
    likes=frozenset({Word.ACTIVE, Word.PEDAL, Word.PRESSURE}),
    against=frozenset(
        {
            *(
                Word.PARKING,
                Word.TARGET,
                Word.LIMIT,
                Word.RATE,
                Word.STEERING,
                Word.WHEEL,
                Word.INTERVENTION,
                Word.CLUTCH,
            ),
            *(Word.ENGINE, Word.ACCELERATION, Word.SPEED, Word.GEAR, Word.ACCESSORY, Word.TORQUE),
        }
    ),
    bits=(1, 16),
    must=False,
)
ACCELERATION = Rule(
    Dimension.ACCELERATION,
    needs=[(frozenset({Word.LONGITUDINAL}), 1.5), (frozenset({Word.ACCELERATION}), 0.7)],
    likes=frozenset({Word.ACTUAL}),
    against=frozenset(
        {
            *(
                Word.LATERAL,
                Word.TARGET,
                Word.LIMIT,
                Word.RATE,
                Word.PEDAL,
                Word.DRIVER,
                Word.FILTERED,
                Word.GEARBOX,
                Word.ENGINE,
            )
        }
    ),
)
GRADE = Rule(
    Dimension.ANGLE,
    needs=[(frozenset({Word.GRADE}), 2.5)],
    against=frozenset(
        {*(Word.STEERING, Word.LATERAL, Word.TARGET, Word.LIMIT, Word.PEDAL, Word.RATE, Word.LIGHT)}
    ),
)
DIRECTION = Rule(
    Dimension.AS_IS,
    needs=[
        (frozenset({Word.DIRECTION}), 1.0),
        (frozenset({Word.WHEEL, Word.VEHICLE, Word.SPEED, Word.DRIVER}), 1.0),
    ],
    against=frozenset({*(Word.STEERING, Word.LEVER, Word.LIGHT, Word.TORQUE, Word.TARGET, Word.GEAR)}),
    bits=(1, 4),
)
_WAYS = {
    "forward": r"\b(forwards?|fwd|vorwaerts|vor|avant)\b",
    "backward": r"\b(backwards?|bwd|reverse|rev|rueckwaerts|rueck|arriere|rearward)\b",
    "standstill": r"\b(standstill|stand ?still|stopped|stop|still|stillstand|stationary|arret)\b",
    "unknown": r"\b(unknown|invalid|init|undefined|not (valid|available|defined)|fault|error|fehler|na|sna)\b",
}


def find_brake(material: Material, motion: Motion | None) -> Proposal | Gap:
    """Return a measure of braking."""
    candidates = [
        _brake_judged(material, c, motion) for c in material.candidates(BRAKE) if not wheel_of(c.entry.signal.name)
    ]
    return chosen("inputs.brake", candidates, with_log=material.recording is not None) or gap(
        "inputs.brake", "no measure of braking was found", candidates
    )


def _brake_judged(material: Material, candidate: Candidate, motion: Motion | None) -> Candidate:
    if material.recording is None or not open_verdict(candidate):
        return candidate
    if motion is None or not motion.drives:
        return replace(candidate, verdict=Verdict("nothing", "the log shows no driving to hold it against"))
    values = material.recording.on_grid(candidate.entry)
    known = np.isfinite(values) & np.isfinite(motion.acceleration) & motion.moving
    released = float(np.nanmin(values))
    on = known & (values > released + 0.02 * (float(np.nanmax(values)) - released))
    off = known & ~on
    if min(on.sum(), off.sum()) * STEP_S < 1.0:
        return replace(candidate, verdict=Verdict("nothing", "the log: hardly changes while the car drives"))
    braked, driven = motion.acceleration[on], motion.acceleration[off]
    slowed = float((braked < 0.0).mean())
    if braked.mean() > driven.mean():
        return replace(candidate, verdict=Verdict("contradicts", "the log: set while the car speeds up"))
    if slowed > 0.75 and braked.mean() < driven.mean() - 0.5 * driven.std():
        on_m_s2 = braked.mean() * NOMINAL_RADIUS_M
        why = f"the log: slows down in {slowed:.0%} of the time that it is set, by {-on_m_s2:.1f} m/s² on average"
        return replace(candidate, verdict=Verdict("agrees", why))
    return replace(
        candidate, verdict=Verdict("nothing", f"the log: slows down in {slowed:.0%} of the time that it is set")
    )


def find_acceleration(material: Material, motion: Motion | None) -> Proposal | Gap:
    """Return the longitudinal acceleration."""
    candidates = []
    for each in material.candidates(ACCELERATION):
        if Word.LATERAL in each.entry.own:
            continue
        candidates.append(_acceleration_judged(material, each, motion))
    return chosen("inputs.acceleration", candidates, with_log=material.recording is not None) or gap(
        "inputs.acceleration", "no longitudinal acceleration was found, in m/s² or g", candidates
    )


def _acceleration_judged(material: Material, candidate: Candidate, motion: Motion | None) -> Candidate:
    if material.recording is None or not open_verdict(candidate):
        return candidate
    if motion is None or not motion.drives:
        return replace(candidate, verdict=Verdict("nothing", "the log shows no driving to hold it against"))
    factor = candidate.entry.factor(Dimension.ACCELERATION) or 1.0
    goes = correlation(material.recording.on_grid(candidate.entry) * factor, motion.acceleration, motion.moving)
    if goes < -0.4:
        why = f"the log: against the change of the wheel speeds (correlation {goes:.2f}): factor -1 is needed"
        return replace(candidate, verdict=Verdict("contradicts", why))
    if goes < 0.2:
        why = f"the log: does not go with the change of the wheel speeds (correlation {goes:.2f})"
        return replace(candidate, verdict=Verdict("contradicts", why))
    why = f"the log: goes with the change of the wheel speeds (correlation {goes:.2f})"
    return replace(candidate, verdict=Verdict("agrees", why, 1.0 if goes > 0.5 else 0.5))


def find_grade(material: Material, motion: Motion | None, acceleration: Proposal | Gap) -> Proposal | Gap:
    """Return the inclination of the road."""
    candidates = [_grade_judged(material, c, motion, acceleration) for c in material.candidates(GRADE)]
    return chosen("inputs.grade", candidates, with_log=material.recording is not None) or gap(
        "inputs.grade", "no grade of the road was found, in rad, deg or %", candidates
    )


def _grade_judged(
    material: Material, candidate: Candidate, motion: Motion | None, acceleration: Proposal | Gap
) -> Candidate:
    if material.recording is None or not open_verdict(candidate):
        return candidate
    if motion is None or not isinstance(acceleration, Proposal) or not material.lives(acceleration.entry):
        return replace(candidate, verdict=Verdict("nothing", "the log has no acceleration to hold it against"))
    sensed = material.recording.on_grid(acceleration.entry) * (
        acceleration.entry.factor(Dimension.ACCELERATION) or 1.0
    )
    tilt: Floats = (sensed - motion.acceleration * NOMINAL_RADIUS_M) / STANDARD_GRAVITY
    grade = material.recording.on_grid(candidate.entry) * (candidate.entry.factor(Dimension.ANGLE) or 1.0)
    goes = correlation(grade, tilt, motion.moving)
    if goes < -0.4:
        return replace(
            candidate, verdict=Verdict("contradicts", f"the log: of the other sign (correlation {goes:.2f})")
        )
    why = f"the log: goes with acceleration less change of speed (correlation {goes:.2f})"
    return replace(candidate, verdict=Verdict("agrees", why, 1.0) if goes > 0.5 else Verdict("nothing"))


def find_direction(material: Material, motion: Motion | None) -> Proposal | Gap:
    """Return what tells which way the car goes; its value table must name both ways."""
    key = "inputs.direction"
    candidates, values = [], {}
    for each in material.candidates(DIRECTION):
        table = ways_of(each.entry)
        if {"forward", "backward"} <= set(table.values()):
            values[each.entry.name] = table
            candidates.append(_direction_judged(material, each, table, motion))
    proposal = chosen(key, candidates, with_log=material.recording is not None, at_most="likely")
    if proposal is None:
        return gap(key, "no signal was found whose value table has forward and backward", candidates)
    wheels = _of_each_wheel(proposal.entry, [c.entry for c in candidates])
    fields: dict[str, object] = {"values": values[proposal.entry.name]}
    if wheels:
        fields = {"signals": [each.name for each in wheels], **fields}
    return replace(proposal, fields=fields, extra=tuple(e for e in wheels if e.name != proposal.entry.name))


def ways_of(entry: Entry) -> dict[int, str]:
    """Return which way each raw value means, by the value table."""
    found = {}
    for raw, text in entry.choices.items():
        flat = re.sub(r"[_\-]+", " ", plain(text).lower())
        way = next((way for way, pattern in _WAYS.items() if re.search(pattern, flat)), None)
        if way is not None:
            found[raw] = way
    return found


def _direction_judged(
    material: Material, candidate: Candidate, table: dict[int, str], motion: Motion | None
) -> Candidate:
    if material.recording is None or candidate.verdict.says == "absent":
        return candidate
    if motion is None or not motion.drives:
        return replace(candidate, verdict=Verdict("nothing", "the log shows no driving to hold it against"))
    grid = material.recording.on_grid(candidate.entry)
    raw = np.round((grid - candidate.entry.layout.offset) / candidate.entry.layout.scale)
    here = motion.moving & np.isfinite(raw)
    forward = (
        float(np.isin(raw[here], [r for r, way in table.items() if way == "forward"]).mean())
        if here.any()
        else 0.0
    )
    if forward < 0.5:
        return replace(
            candidate, verdict=Verdict("contradicts", f"the log: forward in {forward:.0%} of the driving")
        )
    return replace(candidate, verdict=Verdict("agrees", f"the log: forward in {forward:.0%} of the driving", 0.5))


def _of_each_wheel(best: Entry, others: Sequence[Entry]) -> list[Entry]:
    """Return the four signals of one message and one table, if the best one is that of a wheel."""
    if not wheel_of(best.signal.name):
        return []
    same = [e for e in others if e.message.name == best.message.name and ways_of(e) == ways_of(best)]
    by_wheel = {wheel_of(e.signal.name): e for e in same if wheel_of(e.signal.name)}
    return [by_wheel[key] for key in ("fl", "fr", "rl", "rr") if key in by_wheel] if len(by_wheel) > 1 else []
