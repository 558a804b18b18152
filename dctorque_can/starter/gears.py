"""Gear signals: actual and target of a gearbox, or one for each shaft, and the flag of a shift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dctorque_can.config.units import Dimension
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.gear_judge import GearJudge
from dctorque_can.starter.gear_values import ratio_by_value, without_reverse
from dctorque_can.starter.material import Material
from dctorque_can.starter.motion import STEP_S, Floats, Motion
from dctorque_can.starter.naming import Rule
from dctorque_can.starter.proposal import Candidate, Gap, Level, Proposal, Verdict, chosen, gap
from dctorque_can.starter.shift_flag import find_shift_flag, gear_changes
from dctorque_can.starter.torques import Locked
from dctorque_can.starter.words import Word, number_of

_NO_GEAR = frozenset(
    {
        *(
            Word.LEVER,
            Word.LIMIT,
            Word.RATIO,
            Word.SHIFT,
            Word.TORQUE,
            Word.SPEED,
            Word.ACCELERATION,
            Word.DIRECTION,
        ),
        *(
            Word.PRESSURE,
            Word.PEDAL,
            Word.BRAKE,
            Word.WHEEL,
            Word.STEERING,
            Word.ACCESSORY,
            Word.PARKING,
            Word.LIGHT,
        ),
    }
)
ACTUAL = Rule(
    Dimension.AS_IS,
    needs=[(frozenset({Word.GEAR}), 2.0)],
    likes=frozenset({Word.ACTUAL}),
    against=(_NO_GEAR - {Word.SPEED}) | {Word.TARGET, Word.DISPLAY, Word.DRIVER, Word.INTERVENTION},
    bits=(3, 8),
)
TARGET = Rule(
    Dimension.AS_IS,
    needs=[(frozenset({Word.GEAR}), 1.5), (frozenset({Word.TARGET}), 1.5)],
    against=(_NO_GEAR - {Word.SPEED}) | {Word.DISPLAY, Word.DRIVER},
    bits=(3, 8),
)
_FEW_VALUES = 32
_AHEAD_S, _WITHIN_S = 0.1, 3.0


@dataclass(frozen=True)
class GearFindings:
    """The gears, as they stand in a vehicle file.

    Attributes:
        source: "gearbox", "signals", or "" where no gear signal was found.
        found: proposals for ``gears.actual``, ``gears.target``, ``gears.shaft1``, … ; gaps of what is needed.
        gear: the gear that drives, on the grid: by the actual gear, NaN where not known; None without.
        ratios: total ratio of engine to wheels by gear, as far as the log shows it.
    """

    source: str
    found: list[Proposal | Gap]
    gear: Floats | None
    ratios: dict[int, float]


def find_gears(
    material: Material, locked: Locked | None, motion: Motion | None, shafts: Sequence[Floats]
) -> GearFindings:
    """Return what tells the gears.

    Args:
        material: signals and log.
        locked: where a clutch holds, with the ratio of engine to wheels; None where the log does not show it.
        motion: of the wheels.
        shafts: speeds of both input shafts on the grid, rad/s; empty where not both are known.
    """
    judge = GearJudge(material, locked)
    both = _of_shafts(material, judge, motion, shafts)
    if both:
        return GearFindings("signals", list(both), None, {})
    actual = [judge.judged(c) for c in _gear_like(material, ACTUAL)]
    proposal = _chosen(material, judge, "gears.actual", actual)
    gear = judge.gears(proposal.entry) if proposal is not None and material.lives(proposal.entry) else None
    numbers_sure = proposal is not None and judge.meaning(proposal.entry).sure
    target = [
        judge.judged(c) if gear is None else judge.follows(c, gear, numbers_sure)
        for c in _gear_like(material, TARGET)
    ]
    others = [c for c in target if proposal is None or c.entry.name != proposal.entry.name]
    wanted = _chosen(material, judge, "gears.target", others)
    if proposal is None and wanted is not None:
        why = "no signal of the actual gear was found: the target gear stands in"
        proposal = replace(wanted, key="gears.actual", level="guess", merit=0.5, why=(*wanted.why, why))
        wanted = None
    if proposal is None:
        none: list[Proposal | Gap] = [
            gap("gears.actual", "no gear was found", actual, needed=True),
            find_shift_flag(material, None),
        ]
        return GearFindings("", none, None, {})
    if wanted is not None:
        proposal, wanted = _who_leads(material, judge, proposal, wanted)
    found: list[Proposal | Gap] = [proposal, wanted or gap("gears.target", "no target gear was found", others)]
    gear = judge.gears(proposal.entry) if material.lives(proposal.entry) else None
    found.append(find_shift_flag(material, gear))
    values = judge.values(proposal.entry)
    ratios = {
        values[raw]: ratio for raw, ratio in judge.ratio(proposal.entry).ratios.items() if values.get(raw, 0) > 0
    }
    return GearFindings("gearbox", found, gear, dict(sorted(ratios.items())))


def _chosen(material: Material, judge: GearJudge, key: str, candidates: list[Candidate]) -> Proposal | None:
    proposal = chosen(key, candidates, with_log=material.recording is not None)
    if proposal is None:
        return None
    meaning = judge.meaning(proposal.entry)
    level: Level = proposal.level if meaning.sure or proposal.level == "guess" else "likely"
    return replace(
        proposal, level=level, why=(*proposal.why, meaning.why), fields={"values": meaning.values or None}
    )


def _gear_like(material: Material, rule: Rule) -> list[Candidate]:
    """Return the signals with a name of a gear; one of few values may be called a ratio or a position too."""
    few = replace(rule, against=rule.against - {Word.RATIO, Word.POSITION})
    return [
        *material.candidates(few, [e for e in material.entries if e.steps <= _FEW_VALUES]),
        *material.candidates(rule, [e for e in material.entries if e.steps > _FEW_VALUES]),
    ]


def _of_shafts(
    material: Material, judge: GearJudge, motion: Motion | None, shafts: Sequence[Floats]
) -> list[Proposal]:
    """Return a gear signal for each shaft, if there are two such names."""
    candidates = [c for c in material.candidates(ACTUAL) if c.verdict.says not in ("absent", "contradicts")]
    of_shaft = [
        [c for c in candidates if number_of(c.entry.signal.name) == n and _about_a_shaft(c.entry)] for n in (1, 2)
    ]
    if not all(of_shaft):
        return []
    best = [max(each, key=lambda c: c.merit).entry for each in of_shaft]
    if motion is not None and motion.drives and len(shafts) == 2:
        judge.take_shafts(
            best, [_shaft_ratios(judge.raw(e), s, motion) for e, s in zip(best, shafts, strict=True)]
        )
    found = []
    for n, mine in enumerate(of_shaft, 1):
        judged = [replace(c, verdict=_shaft_gear_verdict(material, judge, c.entry)) for c in mine]
        proposal = _chosen(material, judge, f"gears.shaft{n}", judged)
        if proposal is None:
            return []
        found.append(proposal)
    return _by_parity(judge, found)


def _shaft_ratios(raw: Floats, shaft: Floats, motion: Motion) -> dict[int, float]:
    """Return the ratio of a shaft to the wheels at each raw value of its gear; neutral has none that lasts."""
    locked = Locked.of(shaft, motion)
    return without_reverse(dict(ratio_by_value(raw, locked.ratio, locked.where).ratios), raw)


def _about_a_shaft(entry: Entry) -> bool:
    return bool({Word.SHAFT, Word.CLUTCH, Word.INPUT} & entry.own) or number_of(entry.signal.name) > 0


def _shaft_gear_verdict(material: Material, judge: GearJudge, entry: Entry) -> Verdict:
    if material.recording is None:
        return Verdict("nothing")
    values = judge.values(entry)
    seen = {values[raw] for raw in material.recording.raw_values(entry) if values.get(raw, 0) > 0}
    if len(seen) < 2:
        return Verdict("nothing", "the log shows too few gears of it")
    if len({gear % 2 for gear in seen}) == 1:
        return Verdict("agrees", f"the log: gears {', '.join(map(str, sorted(seen)))} alone", 1.0)
    return Verdict("contradicts", "the log: odd and even gears, as of a whole gearbox")


def _by_parity(judge: GearJudge, found: list[Proposal]) -> list[Proposal]:
    """Return both; doubtful where shaft 1 is told to have the even gears."""
    first = [gear for gear in judge.values(found[0].entry).values() if gear > 0]
    if first and all(gear % 2 == 0 for gear in first):
        why = "the even gears are on the shaft that is called 1: is the numbering another one?"
        return [replace(p, level="likely", why=(*p.why, why)) for p in found]
    return found


def _who_leads(
    material: Material, judge: GearJudge, actual: Proposal, target: Proposal
) -> tuple[Proposal, Proposal]:
    """Return actual and target gear; doubtful where the log has the target follow the actual one."""
    if not (material.lives(actual.entry) and material.lives(target.entry)):
        return actual, target
    lead_s = _lead_s(judge.gears(target.entry), judge.gears(actual.entry))
    if not np.isfinite(lead_s):
        return actual, target
    if lead_s > -_AHEAD_S:
        return actual, replace(
            target, why=(*target.why, f"the log: {max(lead_s, 0.0):.1f} s ahead of the actual gear")
        )
    why = f"the log: {actual.entry.name} changes {-lead_s:.1f} s before {target.entry.name}: is it the target?"
    lower: Level = "likely"
    return (
        replace(actual, level=lower if actual.level == "sure" else actual.level, why=(*actual.why, why)),
        replace(target, level=lower if target.level == "sure" else target.level, why=(*target.why, why)),
    )


def _lead_s(first: Floats, second: Floats) -> float:
    """Return by how many seconds the first of two gears changes earlier: the median; NaN of fewer than three."""
    changes = [gear_changes(gear) for gear in (first, second)]
    ahead = []
    for at, gear in changes[0]:
        near = [
            (other - at) * STEP_S for other, g in changes[1] if g == gear and abs(other - at) * STEP_S < _WITHIN_S
        ]
        if near:
            ahead.append(min(near, key=abs))
    return float(np.median(ahead)) if len(ahead) >= 3 else float("nan")
