"""DBCs read for proposals, and which frames of a log are their messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from cantools.database.can import Database

from dctorque_can.bus.addresses import identifier, is_j1939, j1939_addresses
from dctorque_can.bus.database import DatabaseError, DatabaseFile, Loaded, joined_databases, load_with_remarks
from dctorque_can.bus.dbc_prepare import Needed
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import Address, Frames, group_mask

_NOTHING = Needed(frozenset(), frozenset())


@dataclass(frozen=True)
class Dbc:
    """One DBC.

    Attributes:
        path: of the file.
        database: its messages.
        strict: whether a vehicle file can name it without ``strict: false``.
        remarks: what was left out of it, or read otherwise than it stands there.
    """

    path: Path
    database: Database
    strict: bool
    remarks: tuple[str, ...]


def read_dbc(path: Path) -> Dbc:
    """Read a DBC; what is broken in it is left out, and told.

    Raises:
        DctorqueError: it cannot be read, or holds no message.
    """
    try:
        loaded, strict = load_with_remarks([DatabaseFile(path)]), True
    except DatabaseError:
        loaded, strict = _laxly(path), False
    if not loaded.database.messages:
        raise DctorqueError(f"{path}: holds no message that can be read")
    return Dbc(path, loaded.database, strict, tuple(str(remark) for remark in loaded.remarks))


def _laxly(path: Path) -> Loaded:
    try:
        return load_with_remarks([DatabaseFile(path, strict=False)])
    except DatabaseError:
        return load_with_remarks([DatabaseFile(path, strict=False)], _NOTHING)


def join(dbcs: Sequence[Dbc], channels: Mapping[int, int]) -> Loaded:
    """Return one database of all messages; of two that contradict each other the first, with a remark.

    Args:
        dbcs: of the car.
        channels: by number of the DBC, of `own_channels`.
    """
    on = [channels.get(number) for number in range(len(dbcs))]
    return joined_databases([(each.path, each.database) for each in dbcs], _NOTHING, on)


def own_channels(dbcs: Sequence[Dbc], frames: Frames | None) -> dict[int, int]:
    """Return the channel of each DBC, where two share an identifier and the log has several channels; else {}.

    Each gets the channel on which most of its identifiers came, the most complete one first, no two the same.
    """
    ids = [{identifier(message) for message in dbc.database.messages} for dbc in dbcs]
    shared = any(first & second for k, first in enumerate(ids) for second in ids[:k])
    if frames is None or not shared:
        return {}
    seen = {
        int(channel): set(np.unique(frames.can_id[frames.channel == channel]).tolist())
        for channel in np.unique(frames.channel)
    }
    shares = [
        (len(own & here) / max(len(own), 1), -number, -channel)
        for number, own in enumerate(ids)
        for channel, here in seen.items()
    ]
    found: dict[int, int] = {}
    for share, number, channel in sorted(shares, reverse=True):
        if share > 0.0 and -number not in found and -channel not in found.values():
            found[-number] = -channel
    return found if len(found) == len(dbcs) else {}


@dataclass(frozen=True)
class Addresses:
    """By what frames are known.

    Attributes:
        by_name: address of each message that is known by less than its identifier.
        j1939: numbers of DBCs of which a vehicle file must say ``j1939: true``, since they do not say it.
    """

    by_name: dict[str, Address]
    j1939: frozenset[int]


def addresses(dbcs: Sequence[Dbc], frames: Frames | None, channels: Mapping[int, int]) -> Addresses:
    """Return by what messages are known, where that is not their identifier on any channel.

    Those of 29 bits are known by their J1939 number, where DBC or log say so. The log says it where none of a
    DBC's identifiers came, but some of its numbers did.
    """
    seen = np.unique(frames.can_id) if frames is not None else np.zeros(0, np.uint32)
    by_name: dict[str, Address] = {}
    untold = set()
    for number, dbc in enumerate(dbcs):
        extended = [m for m in dbc.database.messages if m.is_extended_frame]
        told = [m for m in extended if is_j1939(m)]
        if not told and extended and len(seen):
            exact = {identifier(m) for m in extended} & set(seen.tolist())
            groups = {identifier(m) & group_mask(identifier(m)) for m in extended}
            if not exact and groups & {each & group_mask(each) for each in seen.tolist()}:
                told = extended
                untold.add(number)
        known = {m.name: Address(identifier(m)) for m in dbc.database.messages if number in channels}
        known |= j1939_addresses(told, {})
        by_name |= {
            name: replace(each, channel=channels.get(number))
            for name, each in known.items()
            if name not in by_name
        }
    return Addresses(by_name, frozenset(untold))
