"""Decoded signals of whole DBC messages as columns, for logs and plots."""

from __future__ import annotations

import numpy as np
from cantools.database.can import Database, Message, Signal
from numpy.typing import NDArray

from dctorque_can.bus.layout import SignalLayout, layout_problem, selector_problem, selectors
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

TIME = "t_us"


class MessageColumns:
    """Decoder of every signal of a database, without protection, filters or state.

    Signals that cannot be read (longer than 64 bits, outside their message) are left out. Of two messages with one
    identifier the first is read.

    Args:
        database: messages to be decoded.
    """

    def __init__(self, database: Database) -> None:
        self._messages: dict[int, _Columns] = {}
        for message in database.messages:
            can_id = message.frame_id | (EXTENDED_ID if message.is_extended_frame else 0)
            self._messages.setdefault(can_id, _Columns(message))

    @property
    def dtypes(self) -> dict[str, np.dtype[np.void]]:
        """The structured dtype of each message that has a readable signal, by message name."""
        return {each.name: each.dtype for each in self._messages.values() if each.signals}

    def decode(self, frames: Frames) -> dict[str, NDArray[np.void]]:
        """Return the messages found, by name: structured arrays of ``t_us`` and one float64 field per signal.

        The values are physical ones in the unit of the DBC, also where a raw value means "not available"; NaN
        where a multiplexer selects other signals, and of signals that a shorter frame than the DBC's has not.
        Remote and error frames are left out.
        """
        no_data = np.uint8(FrameFlag.REMOTE | FrameFlag.ERROR)
        usable = (frames.flags & no_data) == 0
        found: dict[str, NDArray[np.void]] = {}
        order = np.argsort(frames.can_id, kind="stable")
        ids, starts = np.unique(frames.can_id[order], return_index=True)
        for can_id, rows in zip(ids.tolist(), np.split(order, starts[1:]), strict=False):
            message = self._messages.get(can_id)
            if message is None or not message.signals:
                continue
            chosen = rows[usable[rows]]
            if len(chosen):
                data = frames.data[chosen]
                missing = max(message.length - data.shape[1], 0)
                data = np.pad(data, ((0, 0), (0, missing))) if missing else data
                found[message.name] = message.decode(frames.t_us[chosen], data, frames.length[chosen])
        return found


class _Columns:
    def __init__(self, message: Message) -> None:
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
