"""Decoded signals of whole DBC messages as columns, for logs and plots."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from cantools.database.can import Database, Message, Signal
from numpy.typing import NDArray

from dctorque_can.bus.addresses import address_of
from dctorque_can.bus.layout import SignalLayout, layout_problem, selector_problem, selectors
from dctorque_can.pipeline.frames import EVERY_BIT, Address, FrameFlag, Frames

TIME = "t_us"


class MessageColumns:
    """Decoder of every signal of a database, without protection, filters or state.

    Signals that cannot be read (longer than 64 bits, outside their message) are left out. Of two messages that a
    frame may be, the first is read, and one that is known by its whole identifier before one of J1939.

    Args:
        database: messages to be decoded.
        addresses: by what the frames of a message are known, by its name, where that is not its identifier.
    """

    def __init__(self, database: Database, addresses: Mapping[str, Address] | None = None) -> None:
        self._messages = [_Columns(message, address_of(message, addresses or {})) for message in database.messages]
        self._by_id: dict[int, list[_Columns]] = {}
        for each in self._messages:
            if each.address.mask == EVERY_BIT:
                self._by_id.setdefault(each.address.can_id, []).append(each)
        self._by_group = [each for each in self._messages if each.address.mask != EVERY_BIT]

    @property
    def dtypes(self) -> dict[str, np.dtype[np.void]]:
        """The structured dtype of each message that has a readable signal, by message name."""
        return {each.name: each.dtype for each in self._messages if each.signals}

    def decode(self, frames: Frames) -> dict[str, NDArray[np.void]]:
        """Return the messages found, by name: structured arrays of ``t_us`` and one float64 field per signal.

        The values are physical ones in the unit of the DBC, also where a raw value means "not available"; NaN
        where a multiplexer selects other signals, and of signals that a shorter frame than the DBC's has not.
        Remote and error frames are left out.
        """
        no_data = np.uint8(FrameFlag.REMOTE | FrameFlag.ERROR)
        usable = (frames.flags & no_data) == 0
        rows_of: dict[_Columns, list[NDArray[np.intp]]] = {}
        order = np.argsort(frames.can_id, kind="stable")
        ids, starts = np.unique(frames.can_id[order], return_index=True)
        for can_id, rows in zip(ids.tolist(), np.split(order, starts[1:]), strict=False):
            chosen = rows[usable[rows]]
            for channel in np.flatnonzero(np.bincount(frames.channel[chosen])).tolist():
                message = self._message_of(can_id, channel)
                if message is not None and message.signals:
                    rows_of.setdefault(message, []).append(chosen[frames.channel[chosen] == channel])
        found: dict[str, NDArray[np.void]] = {}
        for message, parts in rows_of.items():
            chosen = np.sort(np.concatenate(parts))
            data = frames.data[chosen]
            missing = max(message.length - data.shape[1], 0)
            data = np.pad(data, ((0, 0), (0, missing))) if missing else data
            found[message.name] = message.decode(frames.t_us[chosen], data, frames.length[chosen])
        return found

    def _message_of(self, can_id: int, channel: int) -> _Columns | None:
        messages = (*self._by_id.get(can_id, ()), *self._by_group)
        return next((each for each in messages if each.address.has(can_id, channel)), None)


class _Columns:
    def __init__(self, message: Message, address: Address) -> None:
        self.address = address
        self.name = message.name
        self.length = message.length
        self.signals = [
            (_field_name(signal), SignalLayout.of(signal), _conditions(message, signal))
            for signal in message.signals
            if not (layout_problem(signal, message.length) or selector_problem(message, signal))
        ]
        self.dtype = np.dtype([(TIME, "i8"), *((name, "f8") for name, _, _ in self.signals)])

    def decode(
        self, t_us: NDArray[np.int64], data: NDArray[np.uint8], length: NDArray[np.uint8]
    ) -> NDArray[np.void]:
        short = bool((length < self.length).any())
        rows = np.empty(len(t_us), self.dtype)
        rows[TIME] = t_us
        for name, layout, conditions in self.signals:
            rows[name] = layout.read(data)
            for selector, ids in conditions:
                rows[name][~np.isin(selector.read_raw(data), ids)] = np.nan
            for each in (layout, *(selector for selector, _ in conditions)) if short else ():
                rows[name][length <= max(each.byte_indices)] = np.nan
        return rows


def _field_name(signal: Signal) -> str:
    return f"{signal.name}_" if signal.name == TIME else str(signal.name)


def _conditions(message: Message, signal: Signal) -> list[tuple[SignalLayout, NDArray[np.uint64]]]:
    return [(SignalLayout.of(selector), np.array(ids, np.uint64)) for selector, ids in selectors(message, signal)]
