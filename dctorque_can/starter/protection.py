"""Checksums and alive counters that fit the frames of a log.

A counter steps by one from frame to frame. A checksum is found by trying each kind that fits its bits; kinds with
an open start are tried with every start. One of 8 bits fits a frame by chance in one of 256 cases.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.checksum_kinds import KINDS
from dctorque_can.bus.protection import bits_of, constant_bytes
from dctorque_can.pipeline.samples import Protection
from dctorque_can.starter.alive_counter import Counter, find_counter
from dctorque_can.starter.catalogue import Entry
from dctorque_can.starter.checksum_trials import declared, trials
from dctorque_can.starter.checksums import Payloads, checksums
from dctorque_can.starter.proposal import Level
from dctorque_can.starter.recording import Recording
from dctorque_can.starter.words import Word

_MOST_FRAMES = 2_000
_FEW_FRAMES = 48  # with which kinds and starts are tried, before all are looked at
_FEWEST_PAYLOADS = 6  # different ones, in which a checksum must fit
_FITS = 0.99
_CHANCE_BITS = 60.0  # a fit with this evidence is no chance: 2^-60, with some thousand trials


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


def find_protection(entries: Sequence[Entry], recording: Recording | None) -> ProtectionFound | str:
    """Return what protects a message, or in words what was not found; "" where nothing looks protected.

    Args:
        entries: all signals of the message.
        recording: of its frames; None without a log.
    """
    message = entries[0].message
    called = [e for e in entries if {Word.CHECKSUM, Word.COUNTER} & e.own]
    if recording is None or not recording.has(entries[0]):
        if any(True for p in declared(entries)):
            return _as_declared(entries, "likely", "the DBC declares it; no log to hold it against")
        names = ", ".join(e.signal.name for e in called)
        return f"{names}: no log to find the kind of checksum and the counter in" if called else ""
    payloads = _payloads(recording, message.name, message.length)
    if len(payloads) < _FEWEST_PAYLOADS:
        return ""
    counter = find_counter(entries, payloads)
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
    data: NDArray[np.uint8] = frames.data[
        (frames.length >= length) & (frames.channel == int(np.argmax(channels)))
    ][:_MOST_FRAMES]
    return data[:, :length] if data.shape[1] >= length else data[:0]


def _as_declared(entries: Sequence[Entry], level: Level, why: str) -> ProtectionFound:
    protection = next(iter(declared(entries)))
    return ProtectionFound(protection.message, level, _fields(protection), (why,))


def _counter_fields(counter: Counter) -> dict[str, Any]:
    names = [e.signal.name for e in counter.signals]
    fields: dict[str, Any] = {"counter_signal": names[0]}
    if len(names) > 1:
        fields["counter_high_signal"] = names[1]
    if counter.modulus != 16:
        fields["counter_modulus"] = counter.modulus
    return fields


def _counter_why(counter: Counter) -> str:
    return f"the counter runs 0..{counter.modulus - 1} and steps by one in {counter.share:.1%} of the frames"


def _fitting(
    entries: Sequence[Entry], data: NDArray[np.uint8], counter: Counter | None
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
        for protection in trials(entries, crc, counter, few, sent_few):
            fits = float((checksums(message, protection, payloads) == sent).mean())
            evidence = bits_of(message, protection.crc_signal) * (len(few.data) - 1)
            if fits < _FITS or evidence < _CHANCE_BITS or not _constants_fit(entries, protection, data):
                continue
            why = [f"{protection.crc} fits {fits:.1%} of {len(data)} frames"]
            if protection.crc in ("e2e_p01", "e2e_p11") and not any(declared(entries)):
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
    entries: Sequence[Entry], data: NDArray[np.uint8], counter: Counter | None
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
