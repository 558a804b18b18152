"""What a log says of a gear signal: do its values go with ratios of engine to wheels, and what do they mean?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.gear_values import (
    NEUTRAL,
    Meaning,
    RatioByValue,
    between_gears,
    gears_of_table,
    gears_reached,
    meaning_of,
    numbered,
    ratio_by_value,
    special_of_table,
    without_reverse,
)
from dctorque_can.starter.material import Material, open_verdict
from dctorque_can.starter.motion import Floats
from dctorque_can.starter.proposal import Candidate, Verdict
from dctorque_can.starter.torques import Locked

_COMES = 0.7  # of the cases, in which an actual gear comes to a target


class GearJudge:
    """What a log says of gear signals."""

    def __init__(self, material: Material, locked: Locked | None) -> None:
        self._material, self._locked = material, locked
        self._ratios: dict[str, RatioByValue] = {}
        self._reached: dict[str, dict[int, int]] = {}
        self._sure: set[str] = set()
        self._of_shaft: dict[str, Meaning | None] = {}

    def raw(self, entry: Entry) -> Floats:
        """Return the raw values of a signal on the grid."""
        assert self._material.recording is not None
        return np.round((self._material.recording.on_grid(entry) - entry.layout.offset) / entry.layout.scale)

    def ratio(self, entry: Entry) -> RatioByValue:
        """Return which ratio each raw value goes with."""
        if self._locked is None or not self._material.lives(entry):
            return RatioByValue({}, 0.0)
        if entry.name not in self._ratios:
            raw = self.raw(entry)
            if table := gears_of_table(entry):
                raw = np.where(np.isin(raw, [each for each, gear in table.items() if gear > 0]), raw, np.nan)
            self._ratios[entry.name] = ratio_by_value(raw, self._locked.ratio, self._locked.where)
        return self._ratios[entry.name]

    def judged(self, candidate: Candidate) -> Candidate:
        """Return a candidate with what the log says."""
        if self._material.recording is None or not open_verdict(candidate):
            return candidate
        if self._locked is None:
            return replace(candidate, verdict=Verdict("nothing", "the log shows no driving to hold it against"))
        by_value = self.ratio(candidate.entry)
        if by_value.tells_gears:
            why = f"the log: each of {len(by_value.ratios)} values goes with one ratio of engine to wheels"
            return replace(candidate, verdict=Verdict("agrees", why))
        if len(by_value.ratios) >= 2 or by_value.fits < 0.5:
            why = "the log: its values do not go with the ratios of engine to wheels"
            return replace(candidate, verdict=Verdict("contradicts", why))
        return replace(candidate, verdict=Verdict("nothing", "the log shows too few gears"))

    def follows(self, candidate: Candidate, gear: Floats, sure: bool) -> Candidate:
        """Return a target gear with whether the actual gear comes to each of its values."""
        if self._material.recording is None or not open_verdict(candidate):
            return candidate
        values, share = gears_reached(self.raw(candidate.entry), gear)
        if (values and share < _COMES) or (not values and share > 0.0):
            why = f"the log: the actual gear comes to its value in {share:.0%} of the cases"
            return replace(candidate, verdict=Verdict("contradicts", why))
        if len({each for each in values.values() if each > 0}) < 2:
            return replace(candidate, verdict=Verdict("nothing", "the log shows too few shifts"))
        self._reached[candidate.entry.name] = values
        if sure:
            self._sure.add(candidate.entry.name)
        why = f"the log: the actual gear comes to its value in {share:.0%} of the cases"
        return replace(candidate, verdict=Verdict("agrees", why))

    def meaning(self, entry: Entry) -> Meaning:
        """Return what the raw values mean; nothing where neither table nor log tell it."""
        if table := gears_of_table(entry):
            return Meaning(table, "values: by its value table", True)
        named = special_of_table(entry)
        if reached := self._reached.get(entry.name):
            values = dict(sorted((reached | named).items()))
            return Meaning(values, "values: by the actual gear that is reached", entry.name in self._sure)
        if entry.name in self._of_shaft:
            found: Meaning | None = self._of_shaft[entry.name]
        else:
            ratios = {raw: r for raw, r in self.ratio(entry).ratios.items() if raw not in named}
            if self._material.lives(entry):
                ratios = without_reverse(ratios, self.raw(entry))
            numbers = dict(zip(ratios, numbered(list(ratios.values())), strict=False))
            found = meaning_of(entry, ratios, numbers)
        if found is None:
            return Meaning({}, "values: a gap, neither table nor log tell them", False)
        if NEUTRAL not in named.values() and self._material.lives(entry):
            gears = {raw: gear for raw, gear in found.values.items() if gear != NEUTRAL}
            between = between_gears(self.raw(entry), {*gears, *named})
            if between is not None:
                why = f"{found.why}; raw {between} comes between them"
                found = replace(found, values=gears | {between: NEUTRAL}, why=why)
        return Meaning(dict(sorted((found.values | named).items())), f"values: {found.why}", found.sure)

    def values(self, entry: Entry) -> dict[int, int]:
        """Return the gears by raw value; {} where neither table nor log tell them."""
        return self.meaning(entry).values

    def take_shafts(self, entries: Sequence[Entry], ratios: Sequence[dict[int, float]]) -> None:
        """Number the gears of both shafts together, by the ratios of either."""
        together = [(k, raw, ratio) for k, of_shaft in enumerate(ratios) for raw, ratio in of_shaft.items()]
        numbers = numbered([ratio for _, _, ratio in together])
        for k, entry in enumerate(entries):
            own = {raw: number for (shaft, raw, _), number in zip(together, numbers, strict=False) if shaft == k}
            self._of_shaft[entry.name] = meaning_of(entry, ratios[k], own)

    def gears(self, entry: Entry) -> Floats:
        """Return the gear on the grid; NaN where the value means none."""
        raw = self.raw(entry)
        result = np.full(len(raw), np.nan)
        for value, gear in self.values(entry).items():
            result[raw == value] = gear
        return result
