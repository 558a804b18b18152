"""How well a name, a comment and a unit fit a quantity."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dctorque_can.config.units import Dimension
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.proposal import Candidate
from dctorque_can.starter.words import Word, plain, unknown_words

NEVER = frozenset({Word.COUNTER, Word.CHECKSUM, Word.VALIDITY, Word.PULSES, Word.TEMPERATURE, Word.TIME})
"""What a measured value is never called."""
_OTHER_UNITS = re.compile(
    r"(deg|°|unit_degr?e?|m|k|µ|u)?(c|celsius|celsi|f|v|volt|a|amp|ampere|w|watt|pa|bar|s|sec|secon|seconds|min|h|hour|"
    r"m|g|l|ohm|j|wh|ah|psi|hz|hpa|mbar|mmhg|day|days|month|year|db|bit|byte|px|ppm|lux|lx|inch|ft|km|miles|counts?)"
    r"(/.*)?|.*(degre|celsi|volt|amper|watt|pascal|secon|liter|litre|mete|joule|gram|ohm|bar|pulse).*",
    re.IGNORECASE,
)
_UNIT_FITS, _NO_UNIT, _ODD_UNIT, _AROUND, _AGAINST, _AGAINST_AROUND = 1.5, -0.5, -1.0, 0.6, -3.0, -1.0


@dataclass(frozen=True)
class Rule:
    """What the name of a quantity is made of.

    Attributes:
        dimension: of its unit; `Dimension.AS_IS` for flags, states and positions.
        needs: groups of words, of each of which one is told: worth the number where the name itself tells it, a
            part of that where comment, message or sender do, and minus the number where nothing does.
        likes: words that make it better.
        against: words that say something else.
        bits: fewest and most bits of a signal.
        must: whether the first group of ``needs`` must be told; else the log alone may speak for a signal.
    """

    dimension: Dimension
    needs: Sequence[tuple[frozenset[Word], float]]
    likes: frozenset[Word] = frozenset()
    against: frozenset[Word] = frozenset()
    bits: tuple[int, int] = (6, 64)
    must: bool = True


def named(entries: Iterable[Entry], rule: Rule) -> list[Candidate]:
    """Return the signals whose unit does not contradict, with the merit of their names; verdicts are for later."""
    return [candidate for entry in entries if (candidate := name_merit(entry, rule)) is not None]


def is_odd(entry: Entry) -> bool:
    """Return whether the unit of a signal is none that is known, of any quantity."""
    measurable = any(entry.factor(each) is not None for each in Dimension if each is not Dimension.AS_IS)
    return not measurable and _OTHER_UNITS.fullmatch(plain(entry.unit)) is None


def name_merit(entry: Entry, rule: Rule) -> Candidate | None:
    """Return a signal as a candidate; None where its unit or its bits cannot be."""
    if not rule.bits[0] <= entry.layout.bits <= rule.bits[1]:
        return None
    if rule.must and not rule.needs[0][0] & (entry.own | entry.around):
        return None
    merit, why, clear = 0.0, [], True
    told: list[str] = []
    for group, worth in rule.needs:
        if group & entry.own:
            merit += worth
            told.append(min(word.name for word in group & entry.own).lower())
        elif group & entry.around:
            merit += _AROUND * worth
            where = "comment" if group & entry.comment else "message"
            told.append(f"{min(word.name for word in group & entry.around).lower()} ({where})")
        else:
            merit -= worth
            clear = False
    if told:
        why.append("name: " + " ".join(told))
    strange = unknown_words(entry.signal.name)
    if strange:
        clear = False
        why.append(f"not understood: {', '.join(strange)}")
    likes = rule.likes & entry.own
    merit += 0.8 * len(likes)
    if likes:
        why.append(", ".join(sorted(word.name.lower() for word in likes)))
    against = (rule.against | NEVER) & entry.own
    around = (rule.against & entry.comment) - entry.own
    if against or around:
        clear = clear and not against
        merit += _AGAINST * min(len(against), 2) + (_AGAINST_AROUND if around else 0.0)
        why.append("but " + ", ".join(sorted(word.name.lower() for word in against | around)))
    if rule.dimension is not Dimension.AS_IS:
        if not entry.unit:
            merit += _NO_UNIT
            clear = False
            why.append("the DBC has no unit")
        elif entry.factor(rule.dimension) is None:
            if not is_odd(entry):
                return None
            merit += _ODD_UNIT
            clear = False
            why.append(f"the unit {entry.unit} says little")
        else:
            merit += _UNIT_FITS
            why.append(f"unit {entry.unit}")
    return Candidate(entry, merit, clear, tuple(why))
