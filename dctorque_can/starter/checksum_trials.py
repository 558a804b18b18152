"""Kinds of checksum tried on the payloads of a message, with data ids and starts solved where they are open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.checksum_kinds import KINDS, Coverage, Step
from dctorque_can.bus.layout import SignalLayout
from dctorque_can.bus.protection import declared_protections
from dctorque_can.bus.vw_mqb import DATA_IDS
from dctorque_can.pipeline.samples import Protection
from dctorque_can.starter.alive_counter import Counter
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.checksums import Payloads, checksums

_FITS_SOME = 0.96
_SAME_AS_OTHERS = ("chrysler", "tesla", "e2e_p11")


def declared(entries: Sequence[Entry]) -> Iterator[Protection]:
    """Yield the protection that the DBC declares for the message of these signals, if it does."""
    message = entries[0].message

    class _One:
        messages = (message,)

    yield from declared_protections(_One())  # type: ignore[arg-type]


def trials(
    entries: Sequence[Entry],
    crc: tuple[Entry, ...],
    counter: Counter | None,
    few: Payloads,
    sent: NDArray[np.uint64],
) -> Iterator[Protection]:
    """Yield protections that fit some frames."""
    message = entries[0].message
    bits = sum(e.layout.bits for e in crc)
    base = Protection(
        message.name,
        crc_signal=crc[0].signal.name,
        crc_high_signal=crc[1].signal.name if len(crc) > 1 else "",
        counter_signal=counter.signals[0].signal.name if counter is not None else "",
        counter_high_signal=counter.signals[1].signal.name
        if counter is not None and len(counter.signals) > 1
        else "",
        counter_modulus=counter.modulus if counter is not None else 16,
    )
    for given in declared(entries):
        if given.crc in KINDS and given.crc_signal == base.crc_signal and _fits(message, given, few, sent):
            yield given
    fitting = [
        replace(base, crc=name)
        for name, kind in KINDS.items()
        if kind.bits == bits and not (kind.needs_counter and counter is None) and name not in _SAME_AS_OTHERS
    ]
    fitting.sort(key=lambda each: each.crc != "hyundai_canfd")  # profile 5 with a known data id: that is told
    for free in (False, True):  # a free start can stand for what another kind has by itself
        for trial in fitting:
            yield from _of_kind(trial, entries, few, sent, free)


def _of_kind(
    base: Protection, entries: Sequence[Entry], few: Payloads, sent: NDArray[np.uint64], free: bool
) -> Iterator[Protection]:
    message, kind = entries[0].message, KINDS[base.crc]
    if not _stands_right(base, entries) or (free and not kind.open):
        return
    if kind.beside is Coverage.DATA_ID_BEFORE:
        yield from _profile_1(base, entries, few, sent)
    elif kind.beside is Coverage.IDS_BY_COUNTER:
        yield from _profile_2(base, entries, few, sent)
    elif kind.data_id_bits and kind.beside in (Coverage.DATA_ID_BEHIND, Coverage.DATA_ID_BEHIND_HIGH_FIRST):
        yield from (
            p
            for p in (replace(base, data_id=each) for each in _data_ids_of_16(base, message, few, sent))
            if _fits(message, p, few, sent)
        )
    elif kind.data_id_at is not None:
        yield from _from_header(base, entries, few, sent)
    else:
        lengths = (0, *range(message.length - 1, max(message.length - 3, 0), -1)) if kind.open else (0,)
        for covered in lengths:
            plain = replace(base, crc_bytes=covered)
            if free:
                yield from _other_starts(plain, message, few, sent)
            elif _fits(message, plain, few, sent):
                yield plain


def _stands_right(base: Protection, entries: Sequence[Entry]) -> bool:
    """Return whether counter and checksum stand where their kind has them."""
    kind = KINDS[base.crc]
    by_name = {e.signal.name: e.layout for e in entries}
    crc = by_name[base.crc_signal]
    counter = by_name.get(base.counter_signal)
    if kind.bits >= 16 and (crc.shift or (crc.step > 0) == kind.big_endian):
        return False
    if counter is None:
        return True
    bits = counter.bits + (by_name[base.counter_high_signal].bits if base.counter_high_signal else 0)
    if kind.counter_bits and bits != kind.counter_bits:
        return False
    return kind.counter_at is None or min(counter.byte_indices) - min(crc.byte_indices) == kind.counter_at


def _fits(message: Any, protection: Protection, few: Payloads, sent: NDArray[np.uint64]) -> bool:
    return float((checksums(message, protection, few) == sent).mean()) >= _FITS_SOME


def _other_starts(base: Protection, message: Any, few: Payloads, sent: NDArray[np.uint64]) -> Iterator[Protection]:
    """Yield the kind with another start or end, if one makes all fit.

    Of a sum the start is what is missing in each frame. A CRC is linear: with the start 0 that is its end.
    """
    kind = KINDS[base.crc]
    plain = replace(base, crc_start=0, crc_xor=0)
    formed = checksums(message, plain, few)
    if kind.step is Step.SUM:
        trial = replace(plain, crc_start=(int(sent[0]) - int(formed[0])) % (1 << kind.bits))
    else:
        trial = replace(plain, crc_xor=int(sent[0] ^ formed[0]))
    if _fits(message, trial, few, sent):
        yield trial


def _profile_1(
    base: Protection, entries: Sequence[Entry], few: Payloads, sent: NDArray[np.uint64]
) -> Iterator[Protection]:
    """Yield AUTOSAR profile 1; of the 256 pairs of bytes of a data id that give one checksum, that below 256."""
    message = entries[0].message
    if base.counter_modulus != 15:
        return
    three = Payloads(few.data[:3], few.counter[:3])
    for data_id in range(256):
        trial = replace(base, data_id=data_id)
        if (checksums(message, trial, three) == sent[:3]).all() and _fits(message, trial, few, sent):
            yield trial
            return
    yield from _alternating(base, message, few, sent)


def _alternating(base: Protection, message: Any, few: Payloads, sent: NDArray[np.uint64]) -> Iterator[Protection]:
    parts = []
    for odd in (0, 1):
        rows = np.flatnonzero(few.counter % 2 == odd)
        part, wanted = Payloads(few.data[rows], few.counter[rows]), sent[rows]
        if len(rows) < 3:
            return
        found = [
            b
            for b in range(256)
            if _fits(message, replace(base, data_id=b << 8 * odd, data_id_mode="alternating"), part, wanted)
        ]
        if not found:
            return
        parts.append(found[0])
    trial = replace(base, data_id=parts[0] | parts[1] << 8, data_id_mode="alternating")
    if _fits(message, trial, few, sent):
        yield trial


def _profile_2(
    base: Protection, entries: Sequence[Entry], few: Payloads, sent: NDArray[np.uint64]
) -> Iterator[Protection]:
    """Yield AUTOSAR profile 2: for each counter the one data id that fits, if every counter was seen."""
    message = entries[0].message
    if base.crc == "vw_mqb":
        if message.name in DATA_IDS and _fits(message, base, few, sent):
            yield base
        return
    if base.counter_modulus != 16:
        return
    tables = [checksums(message, replace(base, data_ids=(b,) * 16), few) for b in range(256)]
    ids = []
    for counter in range(16):
        rows = few.counter == counter
        if rows.sum() < 2:
            return
        fitting = [b for b in range(256) if (tables[b][rows] == sent[rows]).all()]
        if len(fitting) != 1:
            return
        ids.append(fitting[0])
    yield replace(base, data_ids=tuple(ids))


def _data_ids_of_16(base: Protection, message: Any, few: Payloads, sent: NDArray[np.uint64]) -> list[int]:
    """Return the data ids of 16 bits that fit the first frame: a CRC is linear in them."""
    one = Payloads(few.data[:1], few.counter[:1])
    zero = int(checksums(message, replace(base, data_id=0), one)[0])
    wanted = int(sent[0]) ^ zero
    effect = [int(checksums(message, replace(base, data_id=1 << k), one)[0]) ^ zero for k in range(16)]
    return _solved(effect, wanted)


def _solved(effect: Sequence[int], wanted: int) -> list[int]:
    """Return the set of bits whose effects XOR to ``wanted``; [] where there is none."""
    rows: list[tuple[int, int]] = []
    for k, each in enumerate(effect):
        value, bits = each, 1 << k
        for pivot, combination in rows:
            if value ^ pivot < value:
                value, bits = value ^ pivot, bits ^ combination
        if value:
            rows.append((value, bits))
            rows.sort(reverse=True)
    left, found = wanted, 0
    for pivot, combination in rows:
        if left ^ pivot < left:
            left, found = left ^ pivot, found ^ combination
    return [found] if left == 0 else []


def _from_header(
    base: Protection, entries: Sequence[Entry], few: Payloads, sent: NDArray[np.uint64]
) -> Iterator[Protection]:
    """Yield a profile whose header has the data id: read it there."""
    kind, message = KINDS[base.crc], entries[0].message
    assert kind.data_id_at is not None
    crc: SignalLayout = next(e.layout for e in entries if e.signal.name == base.crc_signal)
    at, size = kind.data_id_at
    first = min(crc.byte_indices) + at
    if first < 0 or first + size > message.length:
        return
    data_id = int.from_bytes(bytes(few.data[0, first : first + size]), "big")
    trial = replace(base, data_id=data_id)
    if _fits(message, trial, few, sent):
        yield trial
