"""What the compiled decoder must know of a DBC, as flat tables: built once, read for every frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from cantools.database.can import Database, Message, Signal
from numpy.typing import NDArray

from dctorque_can.bus.addresses import at_term, read_addresses
from dctorque_can.bus.layout import SignalLayout, selectors
from dctorque_can.bus.protection import CHECKSUM, bits_of, checksum_rule
from dctorque_can.pipeline.frames import EVERY_BIT, EXTENDED_ID, Address
from dctorque_can.pipeline.samples import Input, Protection, Term

N_STANDARD_IDS = 2048

FIELD = np.dtype(
    [("lsb_byte", "i8"), ("step", "i8"), ("n_bytes", "i8"), ("shift", "u8"), ("mask", "u8")], align=True
)
"""Where the bits of a signal lie, see `SignalLayout`."""

RAW = np.dtype([("bits", "u8"), ("value", "f8")], align=True)
"""A raw value with a meaning: "not available", an id of a multiplexer, or a key of `Term.values`."""

CONDITION = np.dtype([("field", "i8"), ("first_raw", "i8"), ("n_raws", "i8")], align=True)
"""A multiplexer and the ids under which it selects a signal."""

TERM = np.dtype(
    [
        ("message", "i8"),
        ("field", "i8"),
        ("coding", "i8"),
        ("unused_bits", "u8"),  # 64 - length
        ("scale", "f8"),
        ("offset", "f8"),
        ("factor", "f8"),
        ("si_offset", "f8"),
        ("first_condition", "i8"),
        ("n_conditions", "i8"),
        ("first_not_available", "i8"),
        ("n_not_available", "i8"),
        ("first_value", "i8"),
        ("n_values", "i8"),
    ],
    align=True,
)
"""One `Term`; those of one input stand together."""

INPUT = np.dtype(
    [
        ("quantity", "u1"),
        ("first_term", "i8"),
        ("n_terms", "i8"),
        ("minimum", "f8"),
        ("maximum", "f8"),
        ("timeout_us", "i8"),
        ("multiplier", "i8"),  # its term, which comes after those of the sum; -1: none
        ("multiplier_timeout_us", "i8"),
        ("divides", "b1"),
        ("validity", "i8"),  # the term that says whether it is valid, the last one; -1: none
        ("validity_timeout_us", "i8"),
        ("most_per_s", "f8"),  # infinite: it may change by anything
        ("resolution", "f8"),
    ],
    align=True,
)
"""One `Input`."""

MESSAGE = np.dtype(
    [
        *CHECKSUM,
        ("first_pair", "i8"),
        ("n_pairs", "i8"),
        ("timeout_us", "i8"),  # the shortest of what it brings
        ("crc_field", "i8"),  # that with the lower bits
        ("crc_high_field", "i8"),  # -1: none
        ("counter_field", "i8"),  # that with the lower bits, -1: no counter
        ("counter_high_field", "i8"),  # -1: none
        ("counter_low_bits", "u8"),  # bits of the former
        ("counter_modulus", "i8"),
        ("max_counter_delta", "i8"),
        ("channel", "i8"),  # -1: any
        ("next", "i8"),  # a later message of the same identifier on another channel, -1: none
    ],
    align=True,
)
"""One message that an input reads."""

EXTENDED = np.dtype([("can_id", "u4"), ("message", "i8")], align=True)
"""One 29-bit identifier; sorted."""

GROUP = np.dtype([("can_id", "u4"), ("mask", "u4"), ("message", "i8")], align=True)
"""One J1939 message: the identifiers that agree with ``can_id`` in the bits of ``mask``."""


@dataclass(frozen=True, slots=True)
class DecoderTables:
    """The tables of one decoder.

    Attributes:
        standard: int64 ``[2048]``, message of an 11-bit identifier, -1 for none.
        extended: `EXTENDED`.
        groups: `GROUP`.
        messages: `MESSAGE`.
        pairs: int64, the inputs that a message renews, in order of quantity.
        inputs: `INPUT`.
        terms: `TERM`.
        conditions: `CONDITION`.
        fields: `FIELD`.
        raws: `RAW`.
    """

    standard: NDArray[np.int64]
    extended: NDArray[np.void]
    groups: NDArray[np.void]
    messages: NDArray[np.void]
    pairs: NDArray[np.int64]
    inputs: NDArray[np.void]
    terms: NDArray[np.void]
    conditions: NDArray[np.void]
    fields: NDArray[np.void]
    raws: NDArray[np.void]


@dataclass(slots=True)
class _Rows:
    """Rows of the tables while they are written."""

    messages: list[tuple[object, ...]] = field(default_factory=list)
    pairs: list[int] = field(default_factory=list)
    inputs: list[tuple[object, ...]] = field(default_factory=list)
    terms: list[tuple[object, ...]] = field(default_factory=list)
    conditions: list[tuple[object, ...]] = field(default_factory=list)
    fields: list[tuple[object, ...]] = field(default_factory=list)
    raws: list[tuple[int, float]] = field(default_factory=list)

    def add_field(self, signal: Signal) -> int:
        layout = SignalLayout.of(signal)
        self.fields.append((layout.lsb_byte, layout.step, layout.n_bytes, layout.shift, layout.mask))
        return len(self.fields) - 1

    def add_raws(self, bits: Sequence[int], values: Sequence[float] = ()) -> tuple[int, int]:
        self.raws += zip(bits, values or [0.0] * len(bits), strict=True)
        return len(self.raws) - len(bits), len(bits)


def build_tables(
    database: Database,
    inputs: Sequence[Input],
    protections: Sequence[Protection],
    addresses: Mapping[str, Address] | None = None,
) -> DecoderTables:
    """Return the tables of inputs and protections that have no `input_problems`."""
    rows = _Rows()
    addresses = addresses or {}
    by_name = {message.name: message for message in database.messages}
    read = list(read_addresses(database, inputs, addresses))
    index = {at: k for k, at in enumerate(read)}

    def message_of(term: Term) -> int:
        return index[term.message, at_term(term, by_name[term.message], addresses)]

    for each in inputs:
        first = len(rows.terms)
        for term in each.signals:
            _add_term(rows, by_name[term.message], term, message_of(term))
        bounds = (each.minimum, each.maximum, each.timeout_us)
        factor = (-1, 0, False)
        if each.multiplier is not None:
            factor = first + len(each.terms), each.multiplier.timeout_us, each.multiplier.divides
        valid = (-1, 0)
        if each.validity is not None:
            valid = len(rows.terms) - 1, each.validity.timeout_us
        change = (each.most_per_s, each.resolution)
        rows.inputs.append((int(each.quantity), first, len(each.terms), *bounds, *factor, *valid, *change))
    protection_of = {protection.message: protection for protection in protections}
    in_order = sorted(range(len(inputs)), key=lambda k: inputs[k].quantity)
    for m, (name, address) in enumerate(read):
        renewed = [k for k in in_order if any(message_of(term) == m for term in inputs[k].signals)]
        timeout_us = min(_timeout_us(inputs[k], m, message_of) for k in renewed)
        protection = protection_of.get(name, Protection(name))
        if protection.channel not in (None, address.channel):
            protection = Protection(name)
        _add_message(rows, by_name[name], protection, renewed, timeout_us)
    messages = np.array(rows.messages, MESSAGE)
    standard = np.full(N_STANDARD_IDS, -1, np.int64)
    extended: dict[int, int] = {}
    groups = []
    for m in reversed(range(len(read))):  # so that each message leads to a later one
        address = read[m][1]
        messages["channel"][m] = -1 if address.channel is None else address.channel
        if address.mask != EVERY_BIT:
            groups.append((address.can_id, address.mask, m))
        elif address.can_id & EXTENDED_ID:
            messages["next"][m] = extended.get(address.can_id, -1)
            extended[address.can_id] = m
        else:
            messages["next"][m] = standard[address.can_id]
            standard[address.can_id] = m
    return DecoderTables(
        standard,
        np.array(sorted(extended.items()), EXTENDED),
        np.array(groups, GROUP),
        messages,
        np.array(rows.pairs, np.int64),
        np.array(rows.inputs, INPUT),
        np.array(rows.terms, TERM),
        np.array(rows.conditions, CONDITION),
        np.array(rows.fields, FIELD),
        np.array(rows.raws, RAW),
    )


def _timeout_us(given: Input, message: int, message_of: Callable[[Term], int]) -> int:
    """Return for how long what a message brings to an input counts."""
    if any(message_of(term) == message for term in given.terms):
        return given.timeout_us
    beside = [each for each in (given.multiplier, given.validity) if each is not None]
    return min(each.timeout_us for each in beside if message_of(each.term) == message)


def _add_term(rows: _Rows, message: Message, term: Term, message_index: int) -> None:
    signal = next(each for each in message.signals if each.name == term.signal)
    layout = SignalLayout.of(signal)
    chain = selectors(message, signal)
    first_condition = len(rows.conditions)
    for selector, ids in chain:
        rows.conditions.append((rows.add_field(selector), *rows.add_raws(ids)))
    not_available = [bits for raw in term.not_available if (bits := layout.bits_of(raw)) is not None]
    values = {bits: value for raw, value in term.values.items() if (bits := layout.bits_of(raw)) is not None}
    rows.terms.append(
        (
            *(message_index, rows.add_field(signal), int(layout.coding), 64 - layout.bits),
            *(layout.scale, layout.offset, term.factor, term.offset),
            *(first_condition, len(chain)),
            *rows.add_raws(sorted(not_available)),
            *rows.add_raws(list(values), list(values.values())),
        )
    )


def _add_message(
    rows: _Rows, message: Message, protection: Protection, renewed: Sequence[int], timeout_us: int
) -> None:
    rule, raws = checksum_rule(message, protection, len(rows.raws))
    rows.raws += raws
    signals = {each.name: each for each in message.signals}
    names = ("crc_signal", "crc_high_signal", "counter_signal", "counter_high_signal")
    given = [signals.get(getattr(protection, name)) for name in names]
    rows.messages.append(
        (
            *rule,
            *(len(rows.pairs), len(renewed), timeout_us),
            *(-1 if signal is None else rows.add_field(signal) for signal in given),
            bits_of(message, protection.counter_signal),
            *(protection.counter_modulus, protection.max_counter_delta),
            *(-1, -1),
        )
    )
    rows.pairs += renewed
