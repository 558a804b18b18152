"""Checksums and alive counters that fit the frames of a log.

A counter steps by one from frame to frame. A checksum is found by trying each kind that fits its bits; kinds with an
open start are tried with every start. So few frames would fit by chance: each of 8 bits does in one of 256 cases.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.checksum_kinds import KINDS, Coverage
from dctorque_can.bus.layout import SignalLayout
from dctorque_can.bus.protection import bits_of, constant_bytes, declared_protections
from dctorque_can.bus.vw_mqb import DATA_IDS
from dctorque_can.pipeline.samples import Protection
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.checksums import Payloads, checksums
from dctorque_can.starter.proposal import Level
from dctorque_can.starter.recording import Recording
from dctorque_can.starter.words import Word

_MOST_FRAMES = 2_000
_FEW_FRAMES = 48  # with which kinds and starts are tried, before all are looked at
_FEWEST_PAYLOADS = 6  # different ones, in which a checksum must fit
_FITS = 0.99
_STEPS = 0.9  # of the steps between frames that must be one: a log may lack frames
_CHANCE_BITS = 60.0  # a fit with this evidence is no chance: 2^-60, with some thousand trials
_SAME_AS_OTHERS = ("chrysler", "tesla", "e2e_p11")


@dataclass(frozen=True)
class ProtectionFound:
    """What protects a message.

    Attributes:
        message: its name.
        level: how sure.
        fields: what stands at its key.
        why: in words.
    """

    message: str
    level: Level
    fields: dict[str, Any]
    why: tuple[str, ...]


@dataclass(frozen=True)
class _Counter:
    signals: tuple[Entry, ...]  # that with the lower bits first
    modulus: int
    values: NDArray[np.int64]
    share: float


def find_protection(entries: Sequence[Entry], recording: Recording | None) -> ProtectionFound | str:
    """Return what protects a message, or in words what was not found; "" where nothing looks protected.

    Args:
        entries: all signals of the message.
        recording: of its frames; None without a log.
    """
    message = entries[0].message
    called = [e for e in entries if {Word.CHECKSUM, Word.COUNTER} & e.own]
    if recording is None or not recording.has(entries[0]):
        if any(True for p in _declared(entries)):
            return _as_declared(entries, "likely", "the DBC declares it; no log to hold it against")
        names = ", ".join(e.signal.name for e in called)
        return f"{names}: no log to find the kind of checksum and the counter in" if called else ""
    payloads = _payloads(recording, message.name, message.length)
    if len(payloads) < _FEWEST_PAYLOADS:
        return ""
    counter = _counter(entries, payloads)
    for kind_fields, why in _fitting(entries, payloads, counter):
        level: Level = "sure"
        return ProtectionFound(message.name, level, kind_fields, why)
    if counter is not None:
        crc = [e for e in entries if Word.CHECKSUM in e.own and e.layout.bits >= 4]
        lives = [e.signal.name for e in crc if len(np.unique(e.layout.read_raw(payloads))) > 1]
        more = f"no known kind of checksum fits {', '.join(lives)}" if lives else "no checksum"
        named = any(Word.COUNTER in e.own for e in counter.signals)
        return ProtectionFound(
            message.name,
            "sure" if named and counter.share > 0.99 else "likely",
            _counter_fields(counter),
            (_counter_why(counter), more),
        )
    lives = [e.signal.name for e in called if len(np.unique(e.layout.read_raw(payloads))) > 1]
    return f"{', '.join(lives)}: no known checksum or counter fits the log" if lives else ""


def _payloads(recording: Recording, message: str, length: int) -> NDArray[np.uint8]:
    frames = recording.frames_of(message)
    channels = np.bincount(frames.channel)
    data = frames.data[(frames.length >= length) & (frames.channel == int(np.argmax(channels)))][:_MOST_FRAMES]
    return data[:, :length] if data.shape[1] >= length else data[:0]


def _declared(entries: Sequence[Entry]) -> Iterator[Protection]:
    message = entries[0].message

    class _One:
        messages = (message,)

    yield from declared_protections(_One())  # type: ignore[arg-type]


def _as_declared(entries: Sequence[Entry], level: Level, why: str) -> ProtectionFound:
    protection = next(iter(_declared(entries)))
    return ProtectionFound(protection.message, level, _fields(protection), (why,))


def _counter(entries: Sequence[Entry], data: NDArray[np.uint8]) -> _Counter | None:
    """Return the alive counter: called so first, and then the shortest one that steps by one."""
    single = [(e,) for e in entries if 2 <= e.layout.bits <= 16 and not e.layout.is_float]
    parts = [e for e in entries if Word.COUNTER in e.own and {Word.LOW_PART, Word.HIGH_PART} & e.own]
    low = [e for e in parts if Word.LOW_PART in e.own]
    high = [e for e in parts if Word.HIGH_PART in e.own]
    pairs = [(low[0], high[0])] if len(low) == len(high) == 1 else []
    found = [c for signals in (*pairs, *single) if (c := _stepping(signals, data)) is not None]
    found = [c for c in found if any(Word.COUNTER in e.own for e in c.signals) or c.share > 0.98]
    return min(
        found,
        key=lambda c: (
            not any(Word.COUNTER in e.own for e in c.signals),
            -len(c.signals),
            len(c.signals[0].signal.name),
        ),
        default=None,
    )


def _stepping(signals: tuple[Entry, ...], data: NDArray[np.uint8]) -> _Counter | None:
    values = np.zeros(len(data), np.int64)
    shift = 0
    for each in signals:
        values |= each.layout.read_raw(data).astype(np.int64) << shift
        shift += each.layout.bits
    top = int(values.max(initial=0)) + 1
    if top < 3 or len(np.unique(values)) < 3:
        return None
    full = 1 << shift
    for modulus in dict.fromkeys((full, top)):
        if modulus < full and modulus not in (full - 1, top):
            continue
        share = float(((np.diff(values) % modulus) == 1).mean())
        if share >= _STEPS and (modulus == full or len(data) > 2 * modulus):
            return _Counter(signals, modulus, values, share)
    return None


def _counter_fields(counter: _Counter) -> dict[str, Any]:
    names = [e.signal.name for e in counter.signals]
    fields: dict[str, Any] = {"counter_signal": names[0]}
    if len(names) > 1:
        fields["counter_high_signal"] = names[1]
    if counter.modulus != 16:
        fields["counter_modulus"] = counter.modulus
    return fields


def _counter_why(counter: _Counter) -> str:
    return f"the counter runs 0..{counter.modulus - 1} and steps by one in {counter.share:.1%} of the frames"


def _fitting(
    entries: Sequence[Entry], data: NDArray[np.uint8], counter: _Counter | None
) -> Iterator[tuple[dict[str, Any], tuple[str, ...]]]:
    """Yield the kinds of checksum that fit, the most usual first."""
    message = entries[0].message
    values = counter.values if counter is not None else np.zeros(len(data), np.int64)
    payloads = Payloads(data, values)
    few = Payloads(*_different(data, values))
    if len(few.data) < _FEWEST_PAYLOADS:
        return
    for crc in _checksum_signals(entries, data, counter):
        sent = _sent(crc, data)
        sent_few = _sent(crc, few.data)
        for protection in _trials(entries, crc, counter, few, sent_few):
            fits = float((checksums(message, protection, payloads) == sent).mean())
            evidence = bits_of(message, protection.crc_signal) * (len(few.data) - 1)
            if fits < _FITS or evidence < _CHANCE_BITS or not _constants_fit(entries, protection, data):
                continue
            why = [f"{protection.crc} fits {fits:.1%} of {len(data)} frames"]
            if protection.crc in ("e2e_p01", "e2e_p11") and not any(_declared(entries)):
                why.append("many data ids give the same checksums: this is the lowest")
            if counter is not None:
                why.append(_counter_why(counter))
            fields = _fields(protection)
            if counter is not None and counter.modulus == KINDS[protection.crc].modulus:
                fields.pop("counter_modulus", None)
            yield fields, tuple(why)
            return


def _different(data: NDArray[np.uint8], values: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return some payloads that differ, spread over the log."""
    rows = np.sort(np.unique(data, axis=0, return_index=True)[1])
    chosen = rows[np.linspace(0, len(rows) - 1, min(len(rows), _FEW_FRAMES)).astype(np.int64)]
    return data[chosen], values[chosen]


def _checksum_signals(
    entries: Sequence[Entry], data: NDArray[np.uint8], counter: _Counter | None
) -> list[tuple[Entry, ...]]:
    """Return what may be a checksum, in one part or in two (low, high): called so first."""
    taken = {e.name for e in counter.signals} if counter is not None else set()
    sizes = {kind.bits for kind in KINDS.values()}
    live = [
        e
        for e in entries
        if e.name not in taken and e.layout.bits in sizes and len(np.unique(e.layout.read_raw(data[:500]))) > 3
    ]
    parts = [e for e in entries if Word.CHECKSUM in e.own and {Word.LOW_PART, Word.HIGH_PART} & e.own]
    low = [e for e in parts if Word.LOW_PART in e.own]
    high = [e for e in parts if Word.HIGH_PART in e.own]
    pairs: list[tuple[Entry, ...]] = [(low[0], high[0])] if len(low) == len(high) == 1 else []
    ordered = sorted(live, key=lambda e: Word.CHECKSUM not in e.own)
    return pairs + [(e,) for e in ordered]


def _sent(crc: tuple[Entry, ...], data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    sent = np.zeros(len(data), np.uint64)
    shift = 0
    for each in crc:
        sent |= each.layout.read_raw(data) << np.uint64(shift)
        shift += each.layout.bits
    return sent


def _trials(
    entries: Sequence[Entry],
    crc: tuple[Entry, ...],
    counter: _Counter | None,
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
    for declared in _declared(entries):
        if (
            declared.crc in KINDS
            and declared.crc_signal == base.crc_signal
            and _fits(message, declared, few, sent)
        ):
            yield declared
    fitting = [
        replace(base, crc=name)
        for name, kind in KINDS.items()
        if kind.bits == bits and not (kind.needs_counter and counter is None) and name not in _SAME_AS_OTHERS
    ]
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
    return float((checksums(message, protection, few) == sent).mean()) >= _FITS - 0.03


def _other_starts(base: Protection, message: Any, few: Payloads, sent: NDArray[np.uint64]) -> Iterator[Protection]:
    """Yield the kind with another start, where one makes all fit: its end is then 0."""
    two = Payloads(few.data[:2], few.counter[:2])
    for start in range(1 << KINDS[base.crc].bits):
        trial = replace(base, crc_start=start, crc_xor=0)
        if (checksums(message, trial, two) == sent[:2]).all() and _fits(message, trial, few, sent):
            yield trial
            return


def _profile_1(
    base: Protection, entries: Sequence[Entry], few: Payloads, sent: NDArray[np.uint64]
) -> Iterator[Protection]:
    """Yield AUTOSAR profile 1: of both bytes of the data id 256 pairs give one checksum; that with high byte 0 is "low"."""
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


def _constants_fit(entries: Sequence[Entry], protection: Protection, data: NDArray[np.uint8]) -> bool:
    constants = constant_bytes(entries[0].message, protection)
    return all(((data[:, byte] ^ bits) & mask == 0).mean() >= _FITS for byte, (bits, mask) in constants.items())


def _fields(protection: Protection) -> dict[str, Any]:
    """Return a protection as it stands in a vehicle file."""
    default = Protection(protection.message)
    fields: dict[str, Any] = {"crc": protection.crc} if protection.crc != "none" else {}
    for name in ("crc_signal", "crc_high_signal", "counter_signal", "counter_high_signal"):
        if getattr(protection, name):
            fields[name] = getattr(protection, name)
    modulus = KINDS[protection.crc].modulus if protection.crc in KINDS else 16
    if protection.counter_signal and protection.counter_modulus != modulus:
        fields["counter_modulus"] = protection.counter_modulus
    if protection.crc in KINDS and KINDS[protection.crc].data_id_bits:
        fields["data_id"] = protection.data_id
    for name in ("data_id_mode", "crc_start", "crc_xor", "crc_bytes"):
        if getattr(protection, name) != getattr(default, name):
            fields[name] = getattr(protection, name)
    if protection.data_ids:
        fields["data_ids"] = list(protection.data_ids)
    return fields
