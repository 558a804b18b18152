"""What tells whether a clutch is open: positions, torques or states."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np

from dctorque_can.config.units import Dimension
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.material import Material, open_verdict
from dctorque_can.starter.motion import Floats, Motion, correlation
from dctorque_can.starter.naming import Rule
from dctorque_can.starter.proposal import Candidate, Gap, Proposal, Verdict, chosen
from dctorque_can.starter.torques import Locked, clutch_verdict, find_clutch_torques
from dctorque_can.starter.words import Word, number_of, plain

_OTHER = frozenset(
    {
        *(
            Word.PEDAL,
            Word.TORQUE,
            Word.SPEED,
            Word.GEAR,
            Word.TARGET,
            Word.DRIVER,
            Word.LIMIT,
            Word.RATE,
            Word.ACCESSORY,
        )
    }
)
POSITION = Rule(
    Dimension.AS_IS,
    needs=[
        (frozenset({Word.CLUTCH, Word.POSITION}), 1.0),
        (frozenset({Word.CLUTCH}), 1.5),
    ],
    likes=frozenset({Word.ACTUAL, Word.POSITION, Word.PRESSURE}),
    against=_OTHER - {Word.SPEED},
    bits=(6, 32),
)
STATE = Rule(
    Dimension.AS_IS,
    needs=[(frozenset({Word.CLUTCH}), 2.0), (frozenset({Word.STATE, Word.POSITION}), 1.0)],
    likes=frozenset({Word.ACTUAL}),
    against=_OTHER,
    bits=(1, 4),
)
_OF_AN_ACTUATOR = re.compile(
    r"m?m|um|%|percent|unit_percent|m?bar|[kmh]?pa|deg|degrees?|inc|steps?|digit|unit_bar|unit_millimete"
)
_STATES = {
    "open": ("open", "offen", "disengag", "released", "geoeffnet", "not engaged", "ouvert"),
    "slipping": ("slip", "schlupf", "schleif", "partial", "engaging", "transition", "regel", "micro", "glisse"),
    "closed": ("clos", "lock", "geschl", "engaged", "zu", "fully", "ferme"),
}


@dataclass(frozen=True)
class ClutchFindings:
    """What tells of the clutches.

    Attributes:
        source: "position", "command", "state" or "none".
        found: proposals for keys below ``clutch_phase``.
        commands: proposals for ``inputs.clutch1_command`` and its twin, where positions tell the phase.
    """

    source: str
    found: list[Proposal | Gap]
    commands: list[Proposal]


def driving_clutch(
    shafts: list[Floats], engine: Floats | None, gear: Floats | None, motion: Motion | None
) -> Floats | None:
    """Return which clutch drives, 1 or 2, on the grid, NaN where not known; None where nothing tells.

    By the shaft that turns with the engine; without two shafts by the gear: odd gears are on shaft 1.
    """
    if motion is None or not motion.drives:
        return None
    if len(shafts) == 2 and engine is not None:
        result = np.full(len(engine), np.nan)
        for n, (mine, other) in enumerate(((shafts[0], shafts[1]), (shafts[1], shafts[0])), 1):
            with np.errstate(invalid="ignore"):
                near = np.abs(mine - engine) < 0.015 * engine
                far = np.abs(other - engine) > 0.05 * engine
            result[motion.moving & near & far] = n
        return result
    if gear is not None:
        with np.errstate(invalid="ignore"):
            return np.where(motion.moving & (gear > 0), 2.0 - gear % 2, np.nan)
    return None


def find_clutches(
    material: Material, drives: Floats | None, locked: Locked | None, motion: Motion | None
) -> ClutchFindings:
    """Return what tells of the clutches: positions before torques before a state; "none" if nothing does."""
    torques = find_clutch_torques(material, drives)
    positions = _positions(material, drives)
    if positions:
        return ClutchFindings("position", list(positions), torques)
    if torques:
        renamed: list[Proposal | Gap] = [
            replace(p, key=f"clutch_phase.clutch{n}", fields={"threshold_nm": 3, "hysteresis_nm": 2})
            for n, p in enumerate(torques, 1)
        ]
        return ClutchFindings("command", renamed, [])
    state = _state(material, locked, motion)
    return ClutchFindings("state", [state], []) if state is not None else ClutchFindings("none", [], [])


def _positions(material: Material, drives: Floats | None) -> list[Proposal]:
    found = []
    for n in (1, 2):
        among = [e for e in material.entries if number_of(e.signal.name) == n]
        candidates = [
            replace(c, verdict=clutch_verdict(material, c.entry, n, drives)) if open_verdict(c) else c
            for c in filter(None, (_way(each) for each in material.candidates(POSITION, among)))
        ]
        proposal = chosen(f"clutch_phase.clutch{n}", candidates, with_log=material.recording is not None)
        if proposal is None or proposal.level == "guess":
            return []
        closes, seen = _closes(material, proposal.entry, n, drives)
        fields = {"kissing_point": None, "hysteresis": None, "closes": closes}
        found.append(replace(proposal, fields=fields, why=(*proposal.why, *seen)))
    return found


def _way(candidate: Candidate) -> Candidate | None:
    """Return the candidate with what its unit says; None where that is neither of a way nor of a pressure."""
    entry = candidate.entry
    if _OF_AN_ACTUATOR.fullmatch(plain(entry.unit).lower()):
        if entry.unit == "%" and Word.TORQUE in entry.own:
            return None
        return replace(candidate, named=candidate.named + 1.0, why=(*candidate.why, f"unit {entry.unit}"))
    if entry.unit or not {Word.POSITION, Word.PRESSURE} & entry.own:
        return None
    return replace(candidate, clear=False, why=(*candidate.why, "the DBC has no unit"))


def _closes(material: Material, entry: Entry, n: int, drives: Floats | None) -> tuple[str | None, tuple[str, ...]]:
    """Return the way in which a clutch closes, and what was seen of it."""
    if drives is None or material.recording is None or not material.lives(entry):
        return None, ()
    values = material.recording.on_grid(entry)
    mine, other = (values[(drives == k) & np.isfinite(values)] for k in (n, 3 - n))
    if not (len(mine) and len(other)):
        return None, ()
    way = "increasing" if np.median(mine) > np.median(other) else "decreasing"
    return way, (f"at {np.median(mine):.3g} while it drives, at {np.median(other):.3g} while the other one does",)


def _state(material: Material, locked: Locked | None, motion: Motion | None) -> Proposal | None:
    candidates = [
        _state_judged(material, c, locked, motion)
        for c in material.candidates(STATE)
        if number_of(c.entry.signal.name) == 0
    ]
    proposal = chosen("clutch_phase.both", candidates, with_log=material.recording is not None)
    if proposal is None or proposal.level == "guess":
        return None
    values, why = _state_values(material, proposal.entry, locked, motion)
    if not values:
        return None
    return replace(proposal, fields={"values": values}, why=(*proposal.why, why))


def _state_judged(
    material: Material, candidate: Candidate, locked: Locked | None, motion: Motion | None
) -> Candidate:
    if material.recording is None or not open_verdict(candidate):
        return candidate
    if locked is None or motion is None:
        return replace(candidate, verdict=Verdict("nothing", "the log shows no driving to hold it against"))
    values = _state_values(material, candidate.entry, locked, motion)[0]
    seen = {values[raw] for raw in material.recording.raw_values(candidate.entry) if raw in values}
    closed = _is_state(material, candidate.entry, values, "closed")
    goes = correlation(closed, locked.where.astype(np.float64), motion.moving)
    if goes > 0.3 and len(seen) > 1:
        return replace(
            candidate, verdict=Verdict("agrees", f"the log: closed where ratios last (correlation {goes:.2f})")
        )
    if goes < 0.05:
        return replace(
            candidate, verdict=Verdict("contradicts", f"the log: not closed where ratios last ({goes:.2f})")
        )
    return replace(candidate, verdict=Verdict("nothing"))


def _is_state(material: Material, entry: Entry, values: dict[int, str], state: str) -> Floats:
    assert material.recording is not None
    grid = material.recording.on_grid(entry)
    raw = np.round((grid - entry.layout.offset) / entry.layout.scale)
    wanted = [each for each, text in values.items() if text == state]
    return np.where(np.isfinite(raw), np.isin(raw, wanted).astype(np.float64), np.nan)


def _state_values(
    material: Material, entry: Entry, locked: Locked | None, motion: Motion | None
) -> tuple[dict[int, str], str]:
    """Return what each raw value means, and why: by the value table, else by when it comes."""
    table: dict[int, str] = {}
    for raw, text in entry.choices.items():
        flat = plain(text).lower()
        state = next((state for state, stems in _STATES.items() if any(stem in flat for stem in stems)), None)
        if state is not None and raw not in entry.no_value:
            table[raw] = state
    if len(set(table.values())) > 1:
        return table, "values: by its value table"
    if material.recording is None or locked is None or motion is None or not material.lives(entry):
        return {}, ""
    grid = material.recording.on_grid(entry)
    raws = np.round((grid - entry.layout.offset) / entry.layout.scale)
    found: dict[int, str] = {}
    for value in material.recording.raw_values(entry):
        here = raws == value
        if here.sum() < 10:
            continue
        holds, rests = float(locked.where[here].mean()), float(motion.resting[here].mean())
        found[value] = "closed" if holds > 0.5 else "open" if rests > 0.5 else "slipping"
    return (
        (found, "values: by when each comes in the log: driving at a lasting ratio, at rest, or between")
        if len(set(found.values())) > 1
        else ({}, "")
    )
