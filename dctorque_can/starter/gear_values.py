"""What the raw values of a gear signal mean: by its value table, or by the ratio of engine to wheels in a log."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dctorque_can.starter.catalogue import Entry, says_no_value
from dctorque_can.starter.motion import Floats, Mask
from dctorque_can.starter.words import plain

NEUTRAL, REVERSE = 0, -1
_ORDINALS = (
    ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth"),
    ("erst", "zweit", "dritt", "viert", "fuenft", "sechst", "siebt", "acht", "neunt", "zehnt"),
    ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"),
)
_NEUTRAL = re.compile(r"\b(n|p|neutral|park|parking|leerlauf|no gear|kein gang|idle|np|p n|n p|nogear)\b")
_CHANGING = re.compile(r"chang|in progress|shifting|wechsel|schalt|transition|intermediate|between")
_REVERSE = re.compile(
    r"\b(r|rev|reverse|rueckwaerts\w*|backward|rg|reversegear|marche arriere|r gang)\b|rueckwaerts|reverse"
)
_FORWARD = re.compile(r"(?<![\d.])(?:gear|gang|g|d|m|s)?[ _]?0?(1[0-5]|[1-9])(?:st|nd|rd|th)?(?![\d.])")
_SHORTEST_STEPS = 20
_AFTER_STEPS, _LATE_STEPS = 10, 25  # of 20 ms
_TIGHT, _APART = 0.03, 0.05
_FEWEST_CHANGES, _MOSTLY = 3, 0.8  # of gears, between which a value comes
_LASTS = 0.25  # of the driving at a value, in which the ratio lasts: in neutral a shaft drifts
_LOWEST, _STEP = (9.0, 24.0), (1.08, 1.9)


def gear_of_text(text: str) -> int | None:
    """Return the gear that a text of a value table means: a number, 0 neutral, -1 reverse; None for none."""
    flat = re.sub(r"[_/\-]+", " ", plain(text).lower()).strip()
    if says_no_value(text):
        return None
    if _REVERSE.search(flat):
        return REVERSE
    for names in _ORDINALS:
        for number, name in enumerate(names, 1):
            if re.search(rf"\b{name}(er|e|en|s)?\b", flat):
                return number
    if found := _FORWARD.search(flat):
        return int(found.group(1))
    if _NEUTRAL.search(flat) or _CHANGING.search(flat):
        return NEUTRAL
    return NEUTRAL if flat == "0" else None


def gears_of_table(entry: Entry) -> dict[int, int]:
    """Return the gears that a value table names, by raw value; {} where it does not name two forward ones."""
    found = {raw: gear for raw, text in entry.choices.items() if (gear := gear_of_text(text)) is not None}
    forward = [gear for gear in found.values() if gear > 0]
    return found if len(forward) >= 2 and len(set(forward)) == len(forward) else {}


def special_of_table(entry: Entry) -> dict[int, int]:
    """Return neutral and reverse as a value table names them that has no forward gears: ``0 "P" 1 "D" 14 "R"``."""
    found = {raw: gear for raw, text in entry.choices.items() if (gear := gear_of_text(text)) is not None}
    return {raw: gear for raw, gear in found.items() if gear in (NEUTRAL, REVERSE)}


@dataclass(frozen=True)
class RatioByValue:
    """The ratio of engine to wheels at each raw value of a signal.

    Attributes:
        ratios: by raw value that came with one lasting ratio.
        fits: share of the lasting ratios that are within 3 % of that of their value.
    """

    ratios: Mapping[int, float]
    fits: float

    @property
    def tells_gears(self) -> bool:
        """Whether there are two values at least, each with a ratio of its own."""
        ordered = sorted(self.ratios.values())
        apart = all(b > (1.0 + _APART) * a for a, b in pairwise(ordered))
        return len(ordered) >= 2 and apart and self.fits > 0.8


def ratio_by_value(raw: Floats, ratio: Floats, locked: Mask) -> RatioByValue:
    """Return which ratio each raw value (``[n]``, NaN where none) goes with while a clutch holds."""
    usable = locked & np.isfinite(raw) & np.isfinite(ratio)
    found: dict[int, tuple[float, int]] = {}
    fitting = 0
    for value in np.unique(raw[usable]):
        here = raw == value
        own = ratio[usable & here]
        if len(own) < _SHORTEST_STEPS:
            continue
        usual = float(np.median(own))
        near = int((np.abs(own - usual) < _TIGHT * usual).sum())
        fitting += near
        if near > 0.6 * len(own) and len(own) > _LASTS * int((here & np.isfinite(ratio)).sum()):
            found[int(value)] = (usual, len(own))
    ratios = {
        value: usual
        for value, (usual, count) in found.items()
        if not any(abs(usual / other - 1.0) < _APART and count < more for other, more in found.values())
    }
    return RatioByValue(ratios, fitting / max(int(usable.sum()), 1))


def numbered(ratios: Sequence[float]) -> list[int]:
    """Return the numbers of forward gears by their total ratios; [] where these do not say it.

    The lowest gear of a car has a total ratio of 9 to 24, and each gear is 1.08 to 1.9 times as short as the next.
    So where the highest ratio is that of a lowest gear, and none is missing between, they are numbered from 1.

    Args:
        ratios: engine or shaft to wheels, of different gears, in any order; wheels in rad/s, or as a road speed
            with wheels of 0.31 m.
    """
    order = sorted(range(len(ratios)), key=lambda k: -ratios[k])
    steps = [ratios[a] / ratios[b] for a, b in pairwise(order)]
    if (
        len(order) < 2
        or not _LOWEST[0] < ratios[order[0]] < _LOWEST[1]
        or not all(_STEP[0] < s < _STEP[1] for s in steps)
    ):
        return []
    numbers = [0] * len(order)
    for number, k in enumerate(order, 1):
        numbers[k] = number
    return numbers


@dataclass(frozen=True)
class Meaning:
    """What the raw values of a gear signal mean.

    Attributes:
        values: gear by raw value.
        why: in words.
        sure: whether more than one thing says so.
    """

    values: dict[int, int]
    why: str
    sure: bool


def meaning_of(entry: Entry, ratios: Mapping[int, float], numbers: Mapping[int, int]) -> Meaning | None:
    """Return what the values of a signal without a value table mean; None where the ratios do not say it.

    Args:
        entry: the signal.
        ratios: by raw value that came with one lasting ratio; reverse is not among them.
        numbers: gear by raw value, of `numbered`; {} where it is silent.
    """
    scale, offset = entry.layout.scale, entry.layout.offset
    physical = {raw: scale * raw + offset for raw in ratios}
    order = sorted(ratios, key=lambda raw: -ratios[raw])
    if len(order) < 2:
        return None
    rises = all(physical[a] < physical[b] for a, b in pairwise(order))
    listed = ", ".join(f"raw {raw}: {ratios[raw]:.2f}" for raw in order)
    if not numbers:
        return None
    same = all(abs(physical[raw] - numbers[raw]) < 1e-6 for raw in order)
    values = {raw: numbers[raw] for raw in order}
    if same:
        zero = round((0.0 - offset) / scale)
        if entry.layout.raw_range[0] <= zero <= entry.layout.raw_range[1]:
            values.setdefault(zero, NEUTRAL)
        return Meaning(
            values, f"no value table; the values are the numbers of the gears by their ratios ({listed})", True
        )
    if not rises:
        return None
    return Meaning(values, f"no value table; numbered by their ratios, engine to wheels ({listed})", False)


def between_gears(raw: Floats, known: Set[int]) -> int | None:
    """Return the raw value that comes between known ones: that of neutral; None where no one value mostly does.

    Args:
        raw: of a gear signal on the grid ``[n]``, NaN where none.
        known: raw values whose meaning is known.
    """
    told = raw[np.isfinite(raw)]
    values = told[np.flatnonzero(np.diff(told, prepend=np.nan) != 0)].astype(np.int64).tolist()
    between = Counter(
        value
        for before, value, after in zip(values, values[1:], values[2:], strict=False)
        if before in known and after in known and value not in known
    )
    if not between:
        return None
    value, count = between.most_common(1)[0]
    return value if count >= _FEWEST_CHANGES and count > _MOSTLY * between.total() else None


def without_reverse(ratios: Mapping[int, float], raw: Floats) -> dict[int, float]:
    """Return the ratios without that of reverse: as short as the lowest gear, and never next to another one."""
    order = sorted(ratios, key=lambda value: -ratios[value])
    if len(order) < 3 or ratios[order[0]] > _STEP[1] * ratios[order[1]]:
        return dict(ratios)
    known = raw[np.isin(raw, order)]
    turns = np.flatnonzero(np.diff(known) != 0)
    pairs = list(zip(known[turns].tolist(), known[turns + 1].tolist(), strict=True))
    for suspect in order[:2]:
        goes_on = any(suspect in pair and order[2] in pair for pair in pairs)
        other = order[1] if suspect == order[0] else order[0]
        if (
            not goes_on
            and any(other in pair and order[2] in pair for pair in pairs)
            and ratios[order[0]] < 1.3 * ratios[order[1]]
        ):
            return {value: ratio for value, ratio in ratios.items() if value != suspect}
    return dict(ratios)


def gears_reached(raw: Floats, gear: Floats) -> tuple[dict[int, int], float]:
    """Return to which actual gear each raw value of a target leads, and in which share of the cases.

    A target may be told from the shift on, or long before as the gear that is preselected. So it counts what the
    actual gear became last before the target changed, or just after.

    Args:
        raw: of the target on the grid, NaN where none.
        gear: actual one on the grid, NaN where not known.
    """
    begins = np.flatnonzero(np.isfinite(raw) & (raw != np.roll(raw, 1)))
    comes = np.flatnonzero(np.isfinite(gear) & (gear > 0) & (gear != np.roll(gear, 1)))
    reached: dict[int, list[int]] = {}
    for first, end in zip(begins, [*begins[1:], len(raw)], strict=True):
        inside = comes[(comes > first + _AFTER_STEPS) & (comes <= end)]
        after = comes[(comes > end) & (comes <= end + _LATE_STEPS)]
        if len(inside) or len(after):
            at = inside[-1] if len(inside) else after[0]
            reached.setdefault(int(raw[first]), []).append(int(gear[at]))
    found = {value: max(sorted(set(each)), key=each.count) for value, each in reached.items()}
    cases = [(value, each) for value, several in reached.items() for each in several]
    share = sum(found[value] == each for value, each in cases) / len(cases) if cases else 0.0
    return (found, share) if len(set(found.values())) == len(found) else ({}, share)
