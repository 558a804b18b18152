"""The flag that says that a shift is in progress: set around the changes of gear, and else seldom."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dctorque_can.config.units import Dimension
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.material import Material, open_verdict
from dctorque_can.starter.motion import Floats
from dctorque_can.starter.naming import Rule
from dctorque_can.starter.proposal import Candidate, Gap, Proposal, Verdict, chosen, gap
from dctorque_can.starter.words import Word

SHIFTING = Rule(
    Dimension.AS_IS,
    needs=[(frozenset({Word.SHIFT}), 2.0), (frozenset({Word.ACTIVE, Word.GEAR, Word.STATE, Word.SHIFT}), 0.5)],
    against=frozenset(
        {Word.LEVER, Word.TARGET, Word.LIMIT, Word.DISPLAY, Word.DRIVER, Word.LIGHT, Word.SHAFT, Word.TORQUE}
    ),
    bits=(1, 3),
    must=False,
)
_NEAR_STEPS = 25  # of 20 ms


def gear_changes(gear: Floats) -> list[tuple[int, float]]:
    """Return when a forward gear begins, and which."""
    known = np.where(gear > 0, gear, np.nan)
    rows = np.flatnonzero(np.isfinite(known))
    values = known[rows]
    new = np.flatnonzero(np.diff(values) != 0) + 1
    return [(int(rows[k]), float(values[k])) for k in new]


def find_shift_flag(material: Material, gear: Floats | None) -> Proposal | Gap:
    """Return the flag that says that a shift is in progress."""
    key = "gears.shift_in_progress"
    judged = [_flag_judged(material, c, gear) for c in material.candidates(SHIFTING)]
    proposal = chosen(key, judged, with_log=material.recording is not None)
    if proposal is None:
        return gap(key, "no shift in progress was found", judged)
    entry = proposal.entry
    idle = _usual_raw(material, entry)
    first, last = entry.layout.raw_range
    values = {raw: "no" if raw == idle else "yes" for raw in range(first, last + 1) if raw not in entry.no_value}
    return replace(proposal, fields={"values": values})


def _usual_raw(material: Material, entry: Entry) -> int:
    if material.recording is None or not material.recording.has(entry):
        return 0
    counts = material.recording.raw_values(entry)
    return max(counts, key=lambda raw: counts[raw], default=0)


def _flag_judged(material: Material, candidate: Candidate, gear: Floats | None) -> Candidate:
    if material.recording is None or not open_verdict(candidate):
        return candidate
    if gear is None:
        return replace(candidate, verdict=Verdict("nothing", "the log shows no gears to hold it against"))
    values = material.recording.on_grid(candidate.entry)
    usual = _usual_raw(material, candidate.entry) * candidate.entry.layout.scale + candidate.entry.layout.offset
    on = np.isfinite(values) & (values != usual)
    changes = [at for at, _ in gear_changes(gear)]
    if len(changes) < 3:
        return replace(candidate, verdict=Verdict("nothing", "the log shows too few shifts"))
    hit = float(np.mean([on[max(at - _NEAR_STEPS, 0) : at + _NEAR_STEPS].any() for at in changes]))
    share = float(on.mean())
    if hit > 0.8 and share < 0.4:
        return replace(
            candidate,
            verdict=Verdict("agrees", f"the log: set at {hit:.0%} of the shifts, {share:.0%} of the time"),
        )
    return replace(
        candidate,
        verdict=Verdict("contradicts", f"the log: set at {hit:.0%} of the shifts, {share:.0%} of the time"),
    )
