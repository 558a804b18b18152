"""Estimates to CAN frames by ``dbc/dctorque.dbc``: cyclic on the time of the estimates."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from cantools.database.can import Database, Message
from numpy.typing import NDArray

from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.output_signals import CONTENTS, estimate_words, physical_values
from dctorque_can.bus.problems import nearest
from dctorque_can.bus.protection import declared_protections
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

MAX_EARLY_US = 1000  # or a tenth of the cycle: an estimate this early is not kept waiting for the next one
_BEFORE_ALL_US = -(1 << 63)
_MAX_STANDARD_ID = 0x7FF
_MAX_EXTENDED_ID = 0x1FFF_FFFF


class OutputEncoder:
    """Encoder of estimates, with counters and CRC kept from call to call.

    A message is sent with the first estimate, then with the first one that reaches its cycle time, less a little
    for jitter, on the estimates' own time; a delayed one does not shift those that follow. After a pause of two
    cycles or any step back (a clock set anew) the cycle starts anew. Values that are not valid are sent as "not
    available". The result does not depend on how the estimates are cut into batches.

    Args:
        database: ``dbc/dctorque.dbc``, or one with the same messages at other places. Messages that it lacks are
            not sent.
        ids: other arbitration ids by message name; above 0x7FF, or with `EXTENDED_ID`, they have 29 bits. The
            data ids of the end-to-end protection stay those of the DBC.
        channel: index of the bus, for `Frames.channel`.

    Raises:
        DctorqueError: the DBC or the ids do not fit.
    """

    def __init__(self, database: Database, ids: Mapping[str, int] | None = None, channel: int = 0) -> None:
        overrides = dict(ids or {})
        protections = {protection.message: protection for protection in declared_protections(database)}
        chosen = [message for message in database.messages if message.name in CONTENTS]
        if not chosen:
            raise DctorqueError(f"output DBC: has none of the messages {', '.join(CONTENTS)}")
        known = [message.name for message in chosen]
        for name in overrides:
            if name not in known:
                hint = nearest(name, known) or tuple(known)
                raise DctorqueError(f"output id of {name}: no such message; did you mean {' or '.join(hint)}?")
        self._messages = [
            _CyclicMessage(
                message,
                MessageEncoder(message, protections.get(message.name)),
                arbitration_id(message, overrides.get(message.name)),
            )
            for message in chosen
        ]
        by_id: dict[int, str] = {}
        for each in self._messages:
            if each.can_id in by_id:
                raise DctorqueError(
                    f"output ids: {each.name} and {by_id[each.can_id]} have the same id 0x{each.can_id:X}"
                )
            by_id[each.can_id] = each.name
        self._channel = channel
        self._width = 8 if max(message.length for message in chosen) <= 8 else 64
        self._none = Frames.empty(0, self._width)
        self._last_us = 0
        self._early_until_us = _BEFORE_ALL_US  # the first estimate is never early

    @property
    def can_ids(self) -> dict[str, int]:
        """The identifiers that are sent, by message name, with `EXTENDED_ID` set for 29-bit ones."""
        return {each.name: each.can_id for each in self._messages}

    @property
    def periods_s(self) -> dict[int, tuple[str, float]]:
        """Name and cycle time of each message, by its identifier."""
        return {each.can_id: (each.name, each.period_us / 1e6) for each in self._messages}

    def encode(self, rows: NDArray[np.void]) -> Frames:
        """Return the frames that are due, in order of time; flags `FrameFlag.SENT`.

        Args:
            rows: `ESTIMATE` ``[n]`` in order of time, but for steps of the clock.
        """
        times = rows["t_us"].tolist()
        if self._is_early(times):
            return self._none
        due = [message.due(times, self._last_us) for message in self._messages]
        self._last_us = times[-1]
        self._early_until_us = min(message.early_until_us for message in self._messages)
        frames = Frames.empty(sum(map(len, due)), self._width)
        words = estimate_words(rows)
        first = 0
        for message, chosen in zip(self._messages, due, strict=True):
            if chosen:
                message.encode(words, np.array(chosen, np.int64), frames, first)
                first += len(chosen)
        order = [row for chosen in due for row in chosen]
        frames.t_us[:] = rows["t_us"][order]
        frames.channel[:] = self._channel
        if len(rows) <= 1:
            return frames
        return frames[np.argsort(order, kind="stable")]

    def _is_early(self, times: list[int]) -> bool:
        """Return whether nothing is due at any of the times, which is so for most estimates."""
        last_us = self._last_us
        for t_us in times:
            if t_us > self._early_until_us or t_us < last_us:
                return False
            last_us = t_us
        self._last_us = last_us
        return True


class _CyclicMessage:
    def __init__(self, message: Message, encoder: MessageEncoder, can_id: int) -> None:
        if not message.cycle_time or message.cycle_time <= 0:
            raise DctorqueError(f"output DBC: {message.name} has no GenMsgCycleTime; give it one in ms")
        self.name = message.name
        self.can_id = can_id
        self._length = message.length
        self._flags = int(FrameFlag.SENT | FrameFlag.FD if message.is_fd or message.length > 8 else FrameFlag.SENT)
        self._encoder = encoder
        self.period_us = int(message.cycle_time * 1000)
        self._early_us = min(self.period_us // 10, MAX_EARLY_US)
        self._next_us: int | None = None
        self._number = list(CONTENTS).index(message.name)
        self._places = encoder.places(CONTENTS[message.name])

    def due(self, times: list[int], last_us: int) -> list[int]:
        """Return the rows with which the message is sent; ``last_us`` is the time before them."""
        rows: list[int] = []
        following, last = self._next_us, last_us
        period = self.period_us
        for row, t in enumerate(times):
            if following is None or t >= following + period or t < last:
                following = t
            last = t
            if t > following - self._early_us:
                rows.append(row)
                following += period
        self._next_us = following
        return rows

    @property
    def early_until_us(self) -> int:
        """Up to this time, if time does not step back, the message is not due."""
        return _BEFORE_ALL_US if self._next_us is None else self._next_us - self._early_us

    def encode(self, words: NDArray[np.int64], chosen: NDArray[np.int64], frames: Frames, first: int) -> None:
        """Fill one empty frame per chosen estimate, from the ``first`` on, but for its time and channel."""
        end = first + len(chosen)
        frames.can_id[first:end] = self.can_id
        frames.length[first:end] = self._length
        frames.flags[first:end] = self._flags
        values = physical_values(self._number, words, chosen)
        frames.data[first:end, : self._length] = self._encoder.encode_values(values, self._places)


def arbitration_id(message: Message, override: int | None) -> int:
    """Return the identifier of a message, or the one that is given instead, with `EXTENDED_ID` for 29 bits.

    Raises:
        DctorqueError: what is given is no identifier.
    """
    if override is None:
        return int(message.frame_id) | (EXTENDED_ID if message.is_extended_frame else 0)
    number = override & ~EXTENDED_ID
    if override < 0 or number > _MAX_EXTENDED_ID:
        raise DctorqueError(f"output id of {message.name}: 0x{override:X} is no id; 0..0x{_MAX_EXTENDED_ID:X} is")
    return number | EXTENDED_ID if override != number or number > _MAX_STANDARD_ID else number
