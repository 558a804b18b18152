"""CAN frames to samples by DBC: the one decoder of live bus and replay."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from cantools.database.can import Database
from numpy.typing import NDArray

from dctorque_can.bus.addresses import read_addresses
from dctorque_can.bus.decoder_memory import (
    change_states,
    decode_batch,
    decoder_memory,
    message_states,
    term_states,
)
from dctorque_can.bus.layout import MAX_BYTES
from dctorque_can.bus.problems import InputError, input_problems, shared_frames
from dctorque_can.bus.tables import build_tables
from dctorque_can.compiled import entry
from dctorque_can.pipeline.frames import Address, Frames
from dctorque_can.pipeline.samples import Input, Protection, Samples

Scalar = TypeVar("Scalar", bound=np.generic)
Bytes = NDArray[np.uint8]


class Decoder:
    """Decoder of the frames that carry the inputs of an estimator.

    Rules:

    * Frames are taken from every channel, unless the address of their message names one. Remote frames, error
      frames and frames sent by us are ignored, as are identifiers that no input reads.
    * A frame gives its samples together, in order of `Quantity`, ``last`` set on the final one.
    * A frame that lacks its alive counter or a byte under its CRC, or in which one of them is wrong, gives one
      sample per quantity of its message with that status and value 0, and changes no value. A longer frame is
      accepted: its end is padding, and the CRC covers the DBC's length.
    * A frame that is shorter than its DBC message gives the signals that lie inside; those that do not are
      NOT_AVAILABLE.
    * The alive counter may step by 1..max_counter_delta. A repeated counter is rejected. After a larger step,
      which is rejected too, the next step counts from there. After the shortest timeout of its inputs without any
      frame that passes the CRC, a message may go on with any counter. A counter that had time to run past half of
      its modulus is a larger step, whatever it shows.
    * A raw value that is listed as not available, is missing in `Term.values`, or is NaN or infinite gives
      NOT_AVAILABLE; the latest usable value of the term stays.
    * A multiplexed signal gives a sample only in frames whose multiplexers select it.
    * An input of several messages is renewed by each of them with the latest values of the others while those are
      younger than the input's timeout; otherwise there is no sample. The range holds for the sum: OUT_OF_RANGE
      leaves the terms as received, so that the next frame can repair the sum.
    * An input with a multiplier is renewed by the signals of its sum alone. A multiplier that is not available, or
      older than its own timeout, gives NOT_AVAILABLE, and so does a division by zero.
    * An input with a `Validity` is NOT_AVAILABLE while that has not told, for its own timeout, that it is valid.
    * A frame with one value out of range is not trusted at all: every quantity of it is OUT_OF_RANGE.
    * A protected message of which many frames are bad is not believed (`belief`): its right frames are
      NOT_BELIEVED until several follow each other. A repeated counter does not count there.
    * A value that has changed by more than `Input.most_per_s` is BAD_RATE until several agree.

    The result does not depend on how the frames are cut into batches. Making a decoder compiles the loop, or loads
    it from disk, so that the first frame is as quick as the next.

    Args:
        database: with every message that the inputs name.
        inputs: at most one per quantity.
        protections: at most one per message.
        addresses: by what the frames of a message are known, by its name; by its identifier on any channel where
            there is none.

    Raises:
        InputError: inputs or protections do not fit the database; all problems at once.

    Attributes:
        most_per_frame: so many samples a frame may give.
        names: of the messages that are read, in the order of `messages`; with the channel where one is told.
    """

    def __init__(
        self,
        database: Database,
        inputs: Sequence[Input],
        protections: Sequence[Protection] = (),
        addresses: Mapping[str, Address] | None = None,
    ) -> None:
        problems = input_problems(database, inputs, protections, addresses)
        problems += shared_frames(database, inputs, addresses)
        if problems:
            raise InputError(problems)
        tables = build_tables(database, inputs, protections, addresses)
        self._memory = decoder_memory(tables)
        self.names = [
            name if address.channel is None else f"{name} (channel {address.channel})"
            for name, address in read_addresses(database, inputs, addresses or {})
        ]
        self.most_per_frame = int(tables.messages["n_pairs"].max(initial=0))
        standard = np.flatnonzero(tables.standard >= 0)
        self._can_ids = frozenset(map(int, (*standard, *tables.extended["can_id"], *tables.groups["can_id"])))
        self._by_group = bool(len(tables.groups))
        self._one = Frames.empty(1, MAX_BYTES)
        self._one_payload = memoryview(self._one.data[0])
        self._none = self.decode(Frames.empty())

    @property
    def can_ids(self) -> frozenset[int]:
        """The identifiers that are read, with `EXTENDED_ID` set for 29-bit ones.

        Every other frame is ignored, unless it is a message of J1939 by its address.
        """
        return self._can_ids

    @property
    def messages(self) -> NDArray[np.void]:
        """`MESSAGE_STATE` ``[n]``, a row for each message that is read, in the order of `names`.

        It is all that changes, beside the `terms` and the `changes`.
        """
        return message_states(self._memory)

    @property
    def terms(self) -> NDArray[np.void]:
        """`TERM_STATE` ``[n]``, a row for each term of an input."""
        return term_states(self._memory)

    @property
    def changes(self) -> NDArray[np.void]:
        """`CHANGE_STATE` ``[n]``, a row for each input."""
        return change_states(self._memory)

    def decode(self, frames: Frames) -> Samples:
        """Return the samples of the frames, in their order.

        Raises:
            ValueError: the columns of the frames differ in length.
        """
        samples = Samples.zeros(len(frames) * self.most_per_frame)
        n = decode_batch(*_columns(frames), self._memory, *_room(samples))
        return samples[: _checked(n)]

    def into(self, samples: Samples) -> Callable[[Frames], int]:
        """Return the function that writes what `decode` returns into ``samples``, and says how many they are.

        It is for a live bus: no column is made anew. The function raises what `decode` does, and ValueError when
        there is no room for `most_per_frame` samples of each frame.
        """
        memory_and_room = self._memory, *_room(samples)
        run = entry(decode_batch, (*_columns(self._one), *memory_and_room))
        return lambda frames: _checked(run(*_columns(frames), *memory_and_room))

    def decode_one(
        self, t_us: int, can_id: int, data: bytes | bytearray, flags: int = 0, channel: int = 0
    ) -> Samples:
        """Return the samples of one frame: the same as `decode`, without the cost of building `Frames`.

        Args:
            t_us: time of the frame, µs.
            can_id: with `EXTENDED_ID` set for a 29-bit identifier.
            data: at most 64 payload bytes.
            flags: bits of `FrameFlag`.
            channel: it came on.
        """
        if can_id not in self._can_ids and not self._by_group:
            return self._none
        one = self._one
        one.t_us[0] = t_us
        one.can_id[0] = can_id
        one.length[0] = len(data)
        one.flags[0] = flags
        one.channel[0] = channel
        self._one_payload[: len(data)] = data
        return self.decode(one)


def _columns(frames: Frames) -> tuple[NDArray[np.int64], NDArray[np.uint32], Bytes, Bytes, Bytes, Bytes]:
    t_us, can_id, length, flags = frames.t_us, frames.can_id, frames.length, frames.flags
    return _plain(t_us), _plain(can_id), _plain(length), _plain(flags), _plain(frames.channel), _plain(frames.data)


def _room(samples: Samples) -> tuple[NDArray[np.int64], Bytes, NDArray[np.float64], Bytes, NDArray[np.bool_]]:
    return samples.t_us, samples.quantity, samples.value, samples.status, samples.last


def _checked(n: int) -> int:
    if n < 0:
        raise ValueError("the columns of the frames differ in length, or there is no room for the samples")
    return n


def _plain(column: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return a contiguous, aligned, writeable array, so that one compiled loop fits all."""
    return column if column.flags.carray else column.copy()
