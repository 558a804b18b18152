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
from dctorque_can.bus.checksum_kinds import KINDS, LAST_STANDARD_ID, Coverage, Kind
from dctorque_can.bus.layout import SignalLayout, layout_problem, selector_problem
from dctorque_can.bus.protection import CRC_KINDS, DATA_ID_MODES, data_ids_of
from dctorque_can.bus.vw_mqb import DATA_IDS
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
        key: of a protection, which of its attributes is wrong, or "".
    """

    where: str
    message: str
    signal: str
    reason: str
    suggestions: tuple[str, ...] = ()
    key: str = ""

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
                f"is {'summed' if given.signals == given.terms else 'used'} {count} times; once is right",
            )
    if given.multiplier is not None and given.multiplier.timeout_us <= 0:
        reason = f"has a multiplier with a timeout of {given.multiplier.timeout_us} µs; it must be positive"
        yield Problem(where, "", "", reason)
    if given.validity is not None and given.validity.timeout_us <= 0:
        reason = f"has a validity with a timeout of {given.validity.timeout_us} µs; it must be positive"
        yield Problem(where, "", "", reason)
    if given.validity is not None and not given.validity.term.values:
        yield Problem(where, "", "", "has a validity without a raw value that means valid")
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


def protection_problems(message: Message, given: Protection) -> Iterator[Problem]:
    """Yield what is wrong with the protection of one message."""
    where = f"protection {message.name}"
    names = [signal.name for signal in message.signals]
    keys = ("counter_signal", "counter_high_signal", "crc_signal", "crc_high_signal")
    named = {key: str(getattr(given, key)) for key in keys if getattr(given, key)}
    found: dict[str, Signal] = {}
    for key, name in named.items():
        signal = _signal(message, name)
        reason = f"is not a signal of {message.name}"
        if signal is not None:
            reason = layout_problem(signal, message.length)
            if not reason and (signal.is_float or signal.multiplexer_ids):
                reason = "must be an integer signal that is in every frame, not multiplexed"
            elif not reason and name in (each.name for each in found.values()):
                reason = "is given twice; checksum and counter have a signal each"
        if reason:
            yield Problem(where, message.name, name, reason, nearest(name, names if signal is None else ()), key)
        elif signal is not None:
            found[key] = signal
    for what in ("counter", "crc"):
        low, high = f"{what}_signal", f"{what}_high_signal"
        if high in named and low not in named:
            reason = f"has the upper bits alone; {low} has the lower ones"
            yield Problem(where, message.name, named[high], reason, (), high)
    kind = KINDS.get(given.crc)
    for key, reason in _of_kind(message, given, kind):
        yield Problem(where, message.name, named.get(key, ""), reason, (), key)
    if found.keys() == named.keys():
        for key, reason in _of_signals(message, given, kind, found):
            yield Problem(where, message.name, named[key], reason, (), key)


def _of_kind(message: Message, given: Protection, kind: Kind | None) -> Iterator[tuple[str, str]]:
    """Yield (attribute, reason) for what does not fit the kind of checksum."""
    crc = given.crc
    if crc not in CRC_KINDS:
        yield "crc", f"has the unknown CRC {crc!r}; known are {', '.join(CRC_KINDS)}"
    elif kind is not None and not given.crc_signal:
        yield "crc_signal", f"has the CRC {crc} but no CRC signal"
    elif kind is None and given.crc_signal:
        yield "crc_signal", "is a CRC signal, but the kind of CRC is none"
    id_bits = kind.data_id_bits if kind is not None and kind.data_id_bits else 16
    if given.data_id_mode == "nibble":
        id_bits = 12
    if not 0 <= given.data_id < 1 << id_bits:
        yield "data_id", f"has the data id {given.data_id}; it has {id_bits} bits, 0..{(1 << id_bits) - 1}"
    if not 0 <= given.crc_bytes <= message.length:
        yield "crc_bytes", f"are {given.crc_bytes} bytes; the message has {message.length}"
    if given.data_id_mode not in DATA_ID_MODES:
        yield "data_id_mode", f"is {given.data_id_mode!r}; known are {', '.join(DATA_ID_MODES)}"
    if kind is None:
        return
    if given.data_id_mode != "both" and kind.beside is not Coverage.DATA_ID_BEFORE:
        yield "data_id_mode", f"has no effect with {crc}; it belongs to e2e_p01 and e2e_p11"
    for key, number in (("crc_start", given.crc_start), ("crc_xor", given.crc_xor)):
        if number is not None and not kind.open:
            able = ", ".join(name for name, each in KINDS.items() if each.open)
            yield key, f"cannot be chosen with {crc}; it can with {able}"
        elif number is not None and not 0 <= number < 1 << kind.bits:
            yield key, f"is {number}; the checksum has {kind.bits} bits, 0..{(1 << kind.bits) - 1}"
    if crc == "hyundai_canfd" and message.frame_id > LAST_STANDARD_ID:
        yield "crc", "has an identifier of 29 bits; hyundai_canfd is known for 11. Give e2e_p05 and its data_id"
    by_counter = kind.beside is Coverage.IDS_BY_COUNTER
    if not given.counter_signal and (by_counter or kind.leaves_counter_out or given.data_id_mode == "alternating"):
        yield "counter_signal", f"has the CRC {crc}, which needs a counter signal"
    if by_counter:
        yield from (("data_ids", reason) for reason in _of_data_ids(message, given))


def _of_data_ids(message: Message, given: Protection) -> Iterator[str]:
    data_ids = data_ids_of(message, given)
    if not data_ids and given.crc == "vw_mqb":
        yield f"are missing, and those of {message.name} are not known; known are {', '.join(DATA_IDS)}"
    elif len(data_ids) != 16:
        yield f"has {len(data_ids)} data ids; {given.crc} needs 16, one per counter value"
    elif not all(0 <= each <= 0xFF for each in data_ids):
        yield "has data ids outside 0..255"


def _of_signals(
    message: Message, given: Protection, kind: Kind | None, found: dict[str, Signal]
) -> Iterator[tuple[str, str]]:
    """Yield (attribute, reason) for signals that have not the bits, or the place, that their role needs."""
    crc = found.get("crc_signal")
    wrong = _of_checksum(given, kind, crc, found.get("crc_high_signal")) if kind is not None and crc else ""
    if wrong:
        yield "crc_signal", wrong
    counter = found.get("counter_signal")
    if counter is not None:
        bits = sum(found[key].length for key in ("counter_signal", "counter_high_signal") if key in found)
        yield from (("counter_signal", reason) for reason in _of_counter(given, kind, bits))
    if kind is None or crc is None or wrong:
        return
    first = min(SignalLayout.of(crc).byte_indices)
    at = first + (kind.counter_at or 0)
    if kind.counter_at is not None and counter is not None and not _lies_at(counter, at, kind.counter_bits):
        order = ", big endian (@0)" if kind.counter_bits > 8 else ""
        yield "counter_signal", f"is not where {given.crc} has it: {kind.counter_bits} bits from byte {at}{order}"
    header = [*(place for place in (kind.length_at, kind.data_id_at) if place is not None)]
    if given.data_id_mode == "nibble":
        header.append((1, 1))
    begin = first + min((place for place, _ in header), default=0)
    end = first + max((place + size for place, size in header), default=0)
    if begin < 0 or end > (given.crc_bytes or message.length):
        reason = f"begins in byte {first}, so that the header of {given.crc} would be in bytes {begin}..{end - 1}"
        yield "crc_signal", f"{reason} of {given.crc_bytes or message.length}"


def _of_checksum(given: Protection, kind: Kind, low: Signal, high: Signal | None) -> str:
    """Return why signals cannot carry the checksum, or ""."""
    layout = SignalLayout.of(low)
    bits = low.length + (0 if high is None else high.length)
    if high is not None and kind.bits > 4:
        return f"is one of two parts; the checksum of {given.crc} is in one signal"
    if kind.bits == 4:
        return "" if bits == 4 else f"has {bits} bits; {given.crc} has 4"
    if kind.bits == 8:
        right = low.length == 8 and layout.shift == 0
        return "" if right else f"has {low.length} bits from bit {low.start}; a CRC is one whole byte"
    order = "big_endian" if kind.big_endian else "little_endian"
    if low.length == kind.bits and layout.shift == 0 and low.byte_order == order:
        return ""
    return (
        f"has {low.length} bits from bit {low.start}, {low.byte_order}; the CRC of {given.crc} is "
        f"{kind.bits // 8} whole bytes, {order} (@{0 if kind.big_endian else 1})"
    )


def _lies_at(signal: Signal, byte: int, bits: int) -> bool:
    """Return whether a signal is just these bits from a byte on, the highest byte first."""
    layout = SignalLayout.of(signal)
    in_order = bits <= 8 or signal.byte_order == "big_endian"
    return in_order and signal.length == bits and layout.shift == 0 and min(layout.byte_indices) == byte


def _of_counter(given: Protection, kind: Kind | None, bits: int) -> Iterator[str]:
    modulus, crc = given.counter_modulus, given.crc
    if kind is not None and kind.counter_bits and (modulus, bits) != (kind.modulus, kind.counter_bits):
        yield f"has {bits} bits and the modulus {modulus}; {crc} has {kind.counter_bits} bits and {kind.modulus}"
    elif not 2 <= modulus <= 1 << bits:
        yield f"has {bits} bits; the counter modulus {modulus} must be 2..{1 << bits}"
    if not 1 <= given.max_counter_delta < max(modulus, 2):
        yield f"may step by {given.max_counter_delta}; the largest step must be 1..{modulus - 1}"
    if kind is not None and kind.beside is Coverage.DATA_ID_BEFORE and modulus != kind.modulus:
        yield f"has the modulus {modulus}; the counter of {crc} runs 0..14, modulus {kind.modulus}"
