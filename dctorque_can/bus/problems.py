"""What is wrong with inputs and protections against a DBC: everything at once, each with what would be right."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import combinations

from cantools.database.can import Database, Message, Signal

from dctorque_can.bus.addresses import address_of, at_term, read_addresses
from dctorque_can.bus.layout import SignalLayout, layout_problem, selector_problem
from dctorque_can.bus.protection import CRC_KINDS, P01_MODULUS, P02_MODULUS
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import EVERY_BIT, Address
from dctorque_can.pipeline.samples import Input, Protection, Term


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong.

    Attributes:
        where: "input engine_speed", "protection EngineData", …
        message: name of the DBC message, or "".
        signal: name of the DBC signal, or "".
        reason: what is wrong and what would be right.
        suggestions: nearest existing names, best first.
    """

    where: str
    message: str
    signal: str
    reason: str
    suggestions: tuple[str, ...] = ()

    def __str__(self) -> str:
        name = ".".join(part for part in (self.message, self.signal) if part)
        hint = f"; did you mean {' or '.join(self.suggestions)}?" if self.suggestions else ""
        return f"{self.where}: {name + ' ' if name else ''}{self.reason}{hint}"


class InputError(DctorqueError):
    """Inputs or protections do not fit the DBC.

    Attributes:
        problems: all of them.
    """

    def __init__(self, problems: Sequence[Problem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = tuple(problems)


def input_problems(
    database: Database,
    inputs: Sequence[Input],
    protections: Sequence[Protection],
    addresses: Mapping[str, Address] | None = None,
) -> list[Problem]:
    """Return everything that keeps inputs and protections from being decoded by a database; empty when nothing.

    ``addresses`` say by what the frames of a message are known, by its name, where that is not its identifier.
    """
    addresses = addresses or {}
    problems: list[Problem] = []
    for quantity, count in Counter(each.quantity for each in inputs).items():
        if count > 1:
            problems.append(Problem(_input(quantity.name), "", "", f"is given {count} times; once is right"))
    for each in inputs:
        problems += _of_input(database, each, addresses)
    for name, count in Counter(each.message for each in protections).items():
        if count > 1:
            reason = f"is protected {count} times; once is right"
            problems.append(Problem(f"protection {name}", name, "", reason))
    for protection in protections:
        message = _message(database, protection.message)
        if message is None:
            problems.append(_unknown_message(database, f"protection {protection.message}", protection.message))
        else:
            problems += protection_problems(message, protection)
    return problems


def _input(quantity: str) -> str:
    return f"input {quantity.lower()}"


def _message(database: Database, name: str) -> Message | None:
    return next((message for message in database.messages if message.name == name), None)


def _unknown_message(database: Database, where: str, name: str) -> Problem:
    known = [message.name for message in database.messages]
    return Problem(where, name, "", "is not a message of the DBC", nearest(name, known))


def nearest(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """Return up to three of the known names that look like ``name``; just the one that differs only in case."""
    folded = {each.casefold(): each for each in known}
    if name.casefold() in folded:
        return (folded[name.casefold()],)
    return tuple(folded[each] for each in get_close_matches(name.casefold(), folded, n=3, cutoff=0.7))


def shared_frames(
    database: Database, inputs: Sequence[Input], addresses: Mapping[str, Address] | None = None
) -> Iterator[Problem]:
    """Yield where one frame would be two of the messages that inputs read, and nobody could say which."""
    read = read_addresses(database, inputs, addresses or {})
    for (name, one), (other_name, other) in combinations(read, 2):
        if not one.meets(other):
            continue
        where = f"input of {name}"
        if name == other_name:
            channels = [f"channel {a.channel}" if a.channel is not None else "any channel" for a in (one, other)]
            reason = f"is read from {' and from '.join(channels)}; give each of its inputs a channel"
            yield Problem(where, name, "", reason)
        elif EVERY_BIT not in (one.mask, other.mask):
            reason = f"has the same J1939 number and source address as {other_name}; give source_addresses"
            yield Problem(where, name, "", reason)


def _of_input(database: Database, given: Input, addresses: Mapping[str, Address]) -> Iterator[Problem]:
    where = _input(given.quantity.name)
    if not given.terms:
        yield Problem(where, "", "", "has no signal; at least one is needed")
    if not given.minimum <= given.maximum:
        reason = f"has the empty range [{given.minimum}, {given.maximum}]"
        yield Problem(where, "", "", f"{reason}; the first must be the smaller one")
    if given.timeout_us <= 0:
        yield Problem(where, "", "", f"has a timeout of {given.timeout_us} µs; it must be positive")
    for (name, signal), count in Counter((term.message, term.signal) for term in given.signals).items():
        if count > 1:
            yield Problem(
                where,
                name,
                signal,
                f"is {'summed' if given.multiplier is None else 'used'} {count} times; once is right",
            )
    if given.multiplier is not None and given.multiplier.timeout_us <= 0:
        reason = f"has a multiplier with a timeout of {given.multiplier.timeout_us} µs; it must be positive"
        yield Problem(where, "", "", reason)
    for term in given.signals:
        yield from _of_term(database, where, term, addresses)


def _of_term(database: Database, where: str, term: Term, addresses: Mapping[str, Address]) -> Iterator[Problem]:
    message = _message(database, term.message)
    if message is None:
        yield _unknown_message(database, where, term.message)
        return
    for other in database.messages:
        same_id = (other.frame_id, other.is_extended_frame) == (message.frame_id, message.is_extended_frame)
        apart = not at_term(term, message, addresses).meets(address_of(other, addresses))
        if same_id and other is not message and not apart:
            reason = f"has the same identifier 0x{message.frame_id:X} as {other.name}; correct the DBC"
            yield Problem(where, message.name, "", reason)
    signal = _signal(message, term.signal)
    if signal is None:
        yield _unknown_signal(database, where, message, term.signal)
        return
    unreadable = layout_problem(signal, message.length) or selector_problem(message, signal)
    if unreadable:
        yield Problem(where, message.name, signal.name, unreadable)
        return
    if not (math.isfinite(term.factor) and math.isfinite(term.offset)):
        reason = f"has factor {term.factor} and offset {term.offset}; both must be finite"
        yield Problem(where, message.name, signal.name, reason)
    layout = SignalLayout.of(signal)
    low, high = layout.raw_range
    for raw in sorted(term.not_available):
        if layout.bits_of(raw) is None:
            reason = f"cannot have the raw value {raw} of `not_available`; it holds {low}..{high}"
            yield Problem(where, message.name, signal.name, reason)
    for raw, value in sorted(term.values.items()):
        if layout.bits_of(raw) is None:
            reason = f"cannot have the raw value {raw} of `values`; it holds {low}..{high}"
            yield Problem(where, message.name, signal.name, reason)
        if not math.isfinite(value):
            reason = f"has the value {value} for raw {raw}; it must be finite"
            yield Problem(where, message.name, signal.name, reason)


def _signal(message: Message, name: str) -> Signal | None:
    return next((signal for signal in message.signals if signal.name == name), None)


def _unknown_signal(database: Database, where: str, message: Message, name: str) -> Problem:
    suggestions = nearest(name, (signal.name for signal in message.signals))
    if not suggestions:
        elsewhere = [
            f"{other.name}.{s.name}" for other in database.messages for s in other.signals if s.name == name
        ]
        suggestions = tuple(elsewhere[:3])
    return Problem(where, message.name, name, f"is not a signal of {message.name}", suggestions)


def protection_problems(message: Message, protection: Protection) -> Iterator[Problem]:
    """Yield what is wrong with the protection of one message."""
    where = f"protection {message.name}"

    def problem(signal: str, reason: str, known: Iterable[str] = ()) -> Problem:
        return Problem(where, message.name, signal, reason, nearest(signal, known))

    names = [signal.name for signal in message.signals]
    for name in filter(None, (protection.counter_signal, protection.crc_signal)):
        signal = _signal(message, name)
        if signal is None:
            yield problem(name, f"is not a signal of {message.name}", names)
            continue
        unreadable = layout_problem(signal, message.length)
        if unreadable:
            yield problem(name, unreadable)
        elif signal.is_float or signal.multiplexer_ids:
            yield problem(name, "must be an integer signal that is in every frame, not multiplexed")
        elif name == protection.crc_signal and (signal.length != 8 or SignalLayout.of(signal).shift != 0):
            yield problem(name, f"has {signal.length} bits from bit {signal.start}; a CRC is one whole byte")
        elif name == protection.counter_signal:
            yield from (problem(name, reason) for reason in _of_counter(signal, protection))

    if protection.crc not in CRC_KINDS:
        known = ", ".join(CRC_KINDS)
        yield Problem(where, message.name, "", f"has the unknown CRC {protection.crc!r}; known are {known}")
    elif protection.crc != "none" and not protection.crc_signal:
        yield problem("", f"has the CRC {protection.crc} but no CRC signal")
    elif protection.crc == "none" and protection.crc_signal:
        yield problem(protection.crc_signal, "is a CRC signal, but the kind of CRC is none")
    if not 0 <= protection.data_id <= 0xFFFF:
        yield problem("", f"has the data id {protection.data_id}; it has 16 bits, 0..65535")
    if protection.crc == "e2e_p02":
        yield from (problem("", reason) for reason in _of_profile_2(protection))


def _of_counter(signal: Signal, protection: Protection) -> Iterator[str]:
    modulus = protection.counter_modulus
    if not 2 <= modulus <= 1 << signal.length:
        yield f"has {signal.length} bits; the counter modulus {modulus} must be 2..{1 << signal.length}"
    if not 1 <= protection.max_counter_delta < max(modulus, 2):
        yield f"may step by {protection.max_counter_delta}; the largest step must be 1..{modulus - 1}"
    if protection.crc == "e2e_p01" and modulus != P01_MODULUS:
        yield f"has the modulus {modulus}; the counter of e2e_p01 runs 0..14, modulus {P01_MODULUS}"
    if protection.crc == "e2e_p02" and (modulus != P02_MODULUS or signal.length != 4):
        yield f"has {signal.length} bits and the modulus {modulus}; e2e_p02 has 4 bits and {P02_MODULUS}"


def _of_profile_2(protection: Protection) -> Iterator[str]:
    if not protection.counter_signal:
        yield "has the CRC e2e_p02, which needs a counter signal"
    if len(protection.data_ids) != P02_MODULUS:
        yield f"has {len(protection.data_ids)} data ids; e2e_p02 needs {P02_MODULUS}, one per counter value"
    elif not all(0 <= each <= 0xFF for each in protection.data_ids):
        yield "has data ids outside 0..255"
