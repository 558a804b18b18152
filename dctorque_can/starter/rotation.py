"""Engine speed and the speeds of the input shafts."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, pi

import numpy as np

from dctorque_can.config.units import Dimension
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.material import Material, open_verdict
from dctorque_can.starter.motion import Floats, Motion, RatioPattern, ratio_pattern, share_together
from dctorque_can.starter.naming import Rule
from dctorque_can.starter.proposal import GUESS, Candidate, Gap, Proposal, Verdict, chosen, gap
from dctorque_can.starter.words import Word, number_of

_OTHERS = frozenset(
    {
        *(
            Word.TARGET,
            Word.LIMIT,
            Word.IDLE,
            Word.RATE,
            Word.DISPLAY,
            Word.FILTERED,
            Word.DRIVER,
            Word.ACCELERATION,
        ),
        *(
            Word.ELECTRIC,
            Word.ACCESSORY,
            Word.STEERING,
            Word.TORQUE,
            Word.RATIO,
            Word.INERTIA,
            Word.PRESSURE,
            Word.BRAKE,
        ),
        *(Word.WHEEL, Word.PEDAL, Word.POSITION, Word.REFERENCE),
    }
)
ENGINE = Rule(
    Dimension.ROTATION,
    needs=[(frozenset({Word.SPEED}), 1.0), (frozenset({Word.ENGINE}), 1.5)],
    likes=frozenset({Word.ACTUAL}),
    against=_OTHERS | {Word.TURBINE, Word.INPUT, Word.SHAFT, Word.CLUTCH, Word.GEARBOX},
    bits=(7, 64),
)
SHAFT = Rule(
    Dimension.ROTATION,
    needs=[
        (frozenset({Word.INPUT, Word.SHAFT, Word.CLUTCH, Word.TURBINE, Word.GEARBOX}), 1.5),
        (frozenset({Word.SPEED}), 0.7),
        (frozenset({Word.INPUT, Word.SHAFT, Word.CLUTCH}), 0.5),
    ],
    likes=frozenset({Word.ACTUAL}),
    against=(_OTHERS - {Word.POSITION}) | {Word.OUTPUT},
    bits=(7, 64),
)
_RPM = pi / 30
_FASTEST_RAD_S = 1150.0
_IDLE_RAD_S = (40.0, 200.0)  # 380 to 1900 rpm
_LASTING, _LITTLE = 0.25, 0.05
_WITH_ENGINE, _DRIVES = 0.04, 0.35


def find_engine(material: Material, motion: Motion | None) -> Proposal | Gap:
    """Return the engine speed."""
    candidates = material.candidates(ENGINE)
    if material.recording is not None:
        candidates = [_engine_judged(material, c, motion) for c in candidates]
    proposal = chosen("inputs.engine_speed", candidates, with_log=material.recording is not None)
    if proposal is None or proposal.level == "guess":
        unnamed = _engine_by_behaviour(material, motion)
        if unnamed is not None and (proposal is None or proposal.merit < unnamed.merit):
            return unnamed
    if proposal is None:
        return gap("inputs.engine_speed", "no engine speed was found, in rpm or rad/s", candidates, needed=True)
    alone = not proposal.alternatives and {Word.ENGINE, Word.SPEED} <= proposal.entry.own
    if material.recording is None and alone and proposal.entry.unit and _is_plain(candidates, proposal):
        return replace(proposal, level="sure", why=(*proposal.why, "the DBC has no other one"))
    return proposal


def _is_plain(candidates: list[Candidate], proposal: Proposal) -> bool:
    best = next(c for c in candidates if c.entry is proposal.entry)
    engine = [c for c in candidates if Word.ENGINE in c.entry.own | c.entry.around and Word.SPEED in c.entry.own]
    return best.clear and len(engine) == 1


def rad_s(material: Material, entry: Entry) -> Floats:
    """Return a speed of the log on the grid, rad/s; without a unit as if in rpm."""
    assert material.recording is not None
    return material.recording.on_grid(entry) * (entry.factor(Dimension.ROTATION) or _RPM)


def _engine_judged(material: Material, candidate: Candidate, motion: Motion | None) -> Candidate:
    if not open_verdict(candidate):
        return candidate
    speed = rad_s(material, candidate.entry)
    return replace(candidate, verdict=_as_engine(speed, motion, bool(candidate.entry.unit)))


def _as_engine(speed: Floats, motion: Motion | None, has_unit: bool) -> Verdict:
    """Return whether a speed goes with the car as that of an engine does."""
    known = speed[np.isfinite(speed)]
    if has_unit and (known.max() > _FASTEST_RAD_S or known.min() < -1.0):
        return Verdict("contradicts", f"the log: from {known.min() / _RPM:.0f} to {known.max() / _RPM:.0f} rpm")
    if motion is None or not motion.drives:
        return Verdict("nothing", "the log shows no driving to hold it against")
    pattern = ratio_pattern(speed, motion)
    at_rest = speed[motion.resting & np.isfinite(speed)]
    if len(pattern.levels) == 1 and pattern.lasting > 0.9:
        return Verdict("contradicts", "the log: follows the wheels at one ratio, as no engine does")
    if pattern.lasting < _LITTLE:
        return Verdict("contradicts", "the log: never at a lasting ratio to the wheels")
    runs = (
        f"the log: at {len(pattern.levels)} lasting ratios to the wheels in {pattern.lasting:.0%} of the driving"
    )
    if pattern.lasting < _LASTING or len(pattern.levels) < 2:
        return Verdict("agrees", runs, 0.5)
    if isnan(pattern.turns_at_rest):
        return Verdict(
            "agrees", f"{runs}; the car is not seen at rest, where an engine idles and a shaft stands", 0.6
        )
    if pattern.turns_at_rest < 0.3:
        return Verdict("nothing", f"{runs}, but it stands when the car stands: rather an input shaft")
    idle = float(np.median(at_rest[at_rest > 0.15 * np.median(known)]))
    if has_unit and not _IDLE_RAD_S[0] < idle < _IDLE_RAD_S[1]:
        return Verdict("agrees", f"{runs}, but turns at {idle / _RPM:.0f} rpm at rest", 0.5)
    tells = f", idles at {idle / _RPM:.0f} rpm" if has_unit else ", idles at rest"
    return Verdict("agrees", runs + tells)


def _unnamed(material: Material, motion: Motion | None) -> list[tuple[Entry, Floats]]:
    """Return the live signals that could be a rotation, whatever their names."""
    if material.recording is None or motion is None or not motion.drives:
        return []
    return [
        (e, rad_s(material, e))
        for e in material.entries
        if 8 <= e.layout.bits <= 32
        and (not e.unit or e.factor(Dimension.ROTATION) is not None)
        and material.lives(e)
        and _is_smooth(material.recording.on_grid(e))
    ]


def _is_smooth(values: Floats) -> bool:
    """Return whether values move as something with inertia does: by little steps through many values."""
    known = values[np.isfinite(values)]
    if len(known) < 50 or len(np.unique(known)) < 50:
        return False
    spread = float(np.percentile(known, 95) - np.percentile(known, 5))
    return spread > 0.0 and float(np.percentile(np.abs(np.diff(known)), 95)) < 0.1 * spread


def _engine_by_behaviour(material: Material, motion: Motion | None) -> Proposal | None:
    """Return the signal that goes with the car as an engine does; never more than likely."""
    found = []
    for entry, speed in _unnamed(material, motion):
        verdict = _as_engine(speed, motion, bool(entry.unit))
        if verdict.says == "agrees" and verdict.strength >= 1.0:
            found.append(Candidate(entry, -0.5, False, ("no name says so",), verdict))
    return chosen("inputs.engine_speed", found, with_log=True, at_most="likely")


def find_shafts(material: Material, motion: Motion | None, engine: Proposal | Gap) -> list[Proposal | Gap]:
    """Return the speeds of both input shafts, or that of the one that drives, or gaps."""
    taken = {engine.entry.name} if isinstance(engine, Proposal) else set()
    candidates = [c for c in material.candidates(SHAFT) if c.entry.name not in taken and c.merit >= GUESS - 4.0]
    engine_speed = (
        rad_s(material, engine.entry) if isinstance(engine, Proposal) and material.lives(engine.entry) else None
    )
    numbered = {n: [c for c in candidates if number_of(c.entry.signal.name) == n] for n in (1, 2)}
    with_log = material.recording is not None
    if all(any(c.verdict.says in ("nothing",) and c.merit > GUESS for c in numbered[n]) for n in (1, 2)):
        judged = {
            n: [_shaft_judged(material, c, motion, engine_speed, _WITH_ENGINE) for c in numbered[n]]
            for n in (1, 2)
        }
        proposals = [chosen(f"inputs.shaft{n}_speed", judged[n], with_log=with_log) for n in (1, 2)]
        if all(proposals):
            return _in_order(material, motion, engine_speed, [each for each in proposals if each is not None])
    judged_one = [_shaft_judged(material, _doubtful_turbine(c), motion, engine_speed, _DRIVES) for c in candidates]
    one = chosen("inputs.driving_shaft_speed", judged_one, with_log=with_log)
    if one is not None:
        return [one]
    unnamed = _shafts_by_behaviour(material, motion, engine_speed, taken)
    if unnamed:
        return list(unnamed)
    why = "no speed of an input shaft was found; the method kalman can do without"
    return [gap(f"inputs.shaft{n}_speed", why, judged_one) for n in (1, 2)]


def _doubtful_turbine(candidate: Candidate) -> Candidate:
    """Return the candidate; a turbine belongs to a torque converter, though some transmissions keep its name."""
    if Word.TURBINE in candidate.entry.own and not {Word.INPUT, Word.SHAFT} & candidate.entry.own:
        return replace(
            candidate, named=candidate.named - 0.5, clear=False, why=(*candidate.why, "called a turbine")
        )
    return candidate


def _shaft_judged(
    material: Material,
    candidate: Candidate,
    motion: Motion | None,
    engine_speed: Floats | None,
    with_engine: float,
) -> Candidate:
    if material.recording is None or not open_verdict(candidate):
        return candidate
    speed = np.abs(rad_s(material, candidate.entry))
    if motion is None or not motion.drives:
        return replace(candidate, verdict=Verdict("nothing", "the log shows no driving to hold it against"))
    pattern = ratio_pattern(speed, motion)
    return replace(candidate, verdict=_as_shaft(speed, pattern, motion, engine_speed, with_engine))


def _as_shaft(
    speed: Floats, pattern: RatioPattern, motion: Motion, engine_speed: Floats | None, with_engine: float
) -> Verdict:
    """Return whether a speed goes with engine and wheels as that of an input shaft does."""
    if len(pattern.levels) == 1 and pattern.lasting > 0.9:
        return Verdict("contradicts", "the log: follows the wheels at one ratio: an output shaft, or a road speed")
    if pattern.lasting < _LITTLE:
        return Verdict("contradicts", "the log: never at a lasting ratio to the wheels")
    runs = (
        f"the log: at {len(pattern.levels)} lasting ratios to the wheels in {pattern.lasting:.0%} of the driving"
    )
    if pattern.turns_at_rest > 0.6:
        return Verdict("contradicts", f"{runs}, but turns when the car stands, as an engine does")
    if engine_speed is None:
        return Verdict("agrees", runs, 0.5)
    together = share_together(speed, engine_speed, motion.moving)
    if together < with_engine:
        return Verdict("nothing", f"{runs}, but with the engine in {together:.0%} only")
    strength = 1.0 if pattern.lasting >= _LASTING and not isnan(pattern.turns_at_rest) else 0.5
    return Verdict("agrees", f"{runs}, with the engine in {together:.0%}, stands with the car", strength)


def _in_order(
    material: Material, motion: Motion | None, engine_speed: Floats | None, proposals: list[Proposal]
) -> list[Proposal | Gap]:
    """Return both shafts; they are doubtful where the log has the lowest gear on the one that is called 2."""
    if motion is None or engine_speed is None or material.recording is None or not motion.drives:
        return list(proposals)
    lowest = []
    for proposal in proposals:
        speed = rad_s(material, proposal.entry)
        with np.errstate(invalid="ignore"):
            apart = np.abs(speed - engine_speed) > 0.015 * np.abs(engine_speed)
        levels = ratio_pattern(np.where(apart, np.nan, speed), motion).levels
        lowest.append(max(levels, default=0.0))
    if not all(lowest) or lowest[0] > lowest[1]:
        return list(proposals)
    why = "the log has the lowest gear on the shaft that is called 2: is the numbering another one?"
    return [
        replace(each, level="likely" if each.level == "sure" else each.level, why=(*each.why, why))
        for each in proposals
    ]


def _shafts_by_behaviour(
    material: Material, motion: Motion | None, engine_speed: Floats | None, taken: set[str]
) -> list[Proposal]:
    """Return one or two signals that go as input shafts do, whatever their names: guesses."""
    if motion is None or engine_speed is None:
        return []
    found: list[tuple[float, float, Entry, Verdict]] = []
    for entry, speed in _unnamed(material, motion):
        if entry.name in taken:
            continue
        verdict = _as_shaft(speed, ratio_pattern(speed, motion), motion, engine_speed, _WITH_ENGINE)
        if verdict.says == "agrees" and verdict.strength >= 1.0:
            with np.errstate(invalid="ignore"):
                apart = np.abs(speed - engine_speed) > 0.015 * np.abs(engine_speed)
            lowest = max(ratio_pattern(np.where(apart, np.nan, speed), motion).levels, default=0.0)
            found.append((lowest, share_together(speed, engine_speed, motion.moving), entry, verdict))
    if len(found) == 1 and found[0][1] > _DRIVES:
        return [
            Proposal("inputs.driving_shaft_speed", "guess", 0.5, (found[0][3].why, "no name says so"), found[0][2])
        ]
    if len(found) != 2:
        return []
    found.sort(key=lambda each: -each[0])
    why = "no name says so; shaft 1 is that with the lowest gear"
    return [
        Proposal(f"inputs.shaft{n}_speed", "guess", 0.5, (each[3].why, why), each[2])
        for n, each in enumerate(found, 1)
    ]
