"""What is proposed for a key of a vehicle file, how sure that is, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from dctorque_can.starter.catalogue import Entry

Level = Literal["sure", "likely", "guess"]
LEVELS: tuple[Level, ...] = ("sure", "likely", "guess")
LIKELY, GUESS = 1.5, 0.0
"""Merit from which a candidate is likely, and from which it is worth to be named at all."""
LEAD = 2.0
"""By how much more merit than any other one a candidate must have to be sure: odds of seven to one."""
_MOST_ALTERNATIVES = 3

Says = Literal["agrees", "contradicts", "nothing", "absent"]
WORTH: dict[Says, float] = {"agrees": 3.0, "nothing": 0.0, "absent": -8.0, "contradicts": -8.0}
"""What the log adds to the merit of a name: e³ is 20 to 1."""


@dataclass(frozen=True)
class Verdict:
    """What a log says of a candidate.

    Attributes:
        says: agrees, contradicts, nothing (it cannot tell), or absent (its message never came).
        why: in words.
        strength: share of the full worth, 0..1.
    """

    says: Says
    why: str = ""
    strength: float = 1.0


NO_LOG = Verdict("nothing")


@dataclass(frozen=True)
class Candidate:
    """One signal for one quantity.

    Attributes:
        entry: the signal.
        named: merit of name, comment and unit, in nats (logarithm of odds).
        clear: whether the name alone says this quantity, without anything that speaks against it.
        why: of name and unit, in words.
        verdict: of the log.
    """

    entry: Entry
    named: float
    clear: bool
    why: tuple[str, ...] = ()
    verdict: Verdict = NO_LOG

    @property
    def merit(self) -> float:
        """Logarithm of the odds that this is the quantity."""
        return self.named + WORTH[self.verdict.says] * self.verdict.strength


@dataclass(frozen=True)
class Proposal:
    """What is proposed for one key.

    Attributes:
        key: dotted, such as ``inputs.engine_speed``.
        level: how sure.
        merit: logarithm of the odds that it is right.
        why: in words.
        entry: its main signal.
        fields: what stands at the key beside ``signal``, in order.
        alternatives: other signals for it, the best first, with their own merit.
        extra: further signals that ``fields`` names, such as friction torque.
    """

    key: str
    level: Level
    merit: float
    why: tuple[str, ...]
    entry: Entry
    fields: dict[str, Any] = field(default_factory=dict)
    alternatives: tuple[Candidate, ...] = ()
    extra: tuple[Entry, ...] = ()

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All its signals."""
        return (self.entry, *self.extra)


@dataclass(frozen=True, slots=True)
class Gap:
    """A key for which nothing was found.

    Attributes:
        key: dotted.
        why: what was looked for, and what is nearest.
        needed: whether no vehicle file can do without.
    """

    key: str
    why: str
    needed: bool


def gap(key: str, why: str, candidates: Sequence[Candidate] = (), *, needed: bool = False) -> Gap:
    """Return a gap that tells which signals are called so, and what speaks against each."""
    called = sorted((c for c in candidates if c.named >= LIKELY), key=lambda c: -c.named)[:_MOST_ALTERNATIVES]
    told = ", ".join(f"{c.entry.name} ({c.verdict.why or c.why[-1]})" for c in called)
    return Gap(key, f"{why}; called so: {told}" if told else why, needed)


def ranked(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates that are worth to be named, the best first."""
    return sorted((each for each in candidates if each.merit >= GUESS), key=lambda each: -each.merit)


def chosen(
    key: str, candidates: Sequence[Candidate], *, with_log: bool, at_most: Level = "sure"
) -> Proposal | None:
    """Return the best candidate as a proposal; None where none is worth it.

    It is sure only if its name is clear, its unit is told, the log agrees, and no other one is nearly as good.

    Args:
        key: dotted.
        candidates: of this quantity.
        with_log: whether there is a log. Without one nothing becomes sure here.
        at_most: the surest that it may be.
    """
    order = ranked(candidates)
    if not order:
        return None
    best = order[0]
    rivals = order[1:]
    why = [*best.why, *([best.verdict.why] if best.verdict.why else [])]
    level: Level = "likely" if best.merit >= LIKELY else "guess"
    if rivals and best.merit - rivals[0].merit < LEAD:
        why.append(f"{rivals[0].entry.name} is nearly as good")
    elif with_log and best.clear and best.verdict.says == "agrees" and best.verdict.strength >= 1.0:
        level = "sure"
    if LEVELS.index(level) < LEVELS.index(at_most):
        level = at_most
    return Proposal(
        key, level, best.merit, tuple(why), best.entry, alternatives=tuple(rivals[:_MOST_ALTERNATIVES])
    )
