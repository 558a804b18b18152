"""The connection to a CAN bus that comes back by itself."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial

import can

from dctorque_can.daemon.background import finished, in_background, settle
from dctorque_can.daemon.wire.error_frames import ErrorFrames
from dctorque_can.daemon.wire.kernel_filter import KernelFilter, Wanted
from dctorque_can.daemon.wire.opening import BusError, DamagedLineError, close_bus, open_bus, reason
from dctorque_can.daemon.wire.pace import Pace
from dctorque_can.daemon.wire.reception import NOTHING, Receiver, receiver_of
from dctorque_can.daemon.wire.sender import Sender, is_full
from dctorque_can.daemon.wire.silence import SilenceWatch, nothing_came
from dctorque_can.daemon.wire.socketcan import MOST
from dctorque_can.pipeline.frames import Frames

__all__ = ["BusError", "BusLink", "LinkCounts", "open_bus"]  # all that one needs for a bus

FIRST_BACKOFF_S = 0.1
LONGEST_BACKOFF_S = 5.0
OPEN_S = 10.0
CLOSE_S = 0.5
REFUSAL_S = 1.0  # without any frame that could be sent: told


@dataclass
class LinkCounts:
    """What happened on the wire.

    Attributes:
        received: messages of any kind.
        error_frames: error frames among them.
        bus_offs: error frames that reported bus-off.
        dropped: messages that the kernel dropped because they were not fetched in time, where it says so.
        damaged: what an interface received and could not read as a message.
        lost: times the bus went away (down, removed, closed by its server).
        silences: times a bus that had given frames gave none for `daemon.wire.silence.SILENCE_S`.
        reconnects: times it came back.
        sent: messages handed to the bus.
        send_failures: messages that the bus did not take.
    """

    received: int = 0
    error_frames: int = 0
    bus_offs: int = 0
    dropped: int = 0
    damaged: int = 0
    lost: int = 0
    silences: int = 0
    reconnects: int = 0
    sent: int = 0
    send_failures: int = 0


class BusLink:
    """Receives and sends on a bus; when the bus goes away it is opened anew, with growing pauses.

    Nothing of it waits longer than it was told to: opening and closing, which may block for ever, are done in the
    background, and so is sending (`sender.Sender`). Whatever an interface raises means that the bus is gone.

    Args:
        connect: opens the bus, e.g. a partial of `open_bus`.
        tell: is told what happens, in one line: ``tell(is_error, text)``.
        listen_only: send nothing, ever: there is not even a `Sender`.
        wanted: frames that are needed, where the kernel can leave out the others; None: all.
    """

    def __init__(
        self,
        connect: Callable[[], can.BusABC],
        tell: Callable[[bool, str], None],
        listen_only: bool = False,
        wanted: Wanted | None = None,
    ) -> None:
        self.counts = LinkCounts()
        self._wanted = wanted
        self._filter: KernelFilter | None = None
        self._listen_only = listen_only
        self._connect = connect
        self._tell = tell
        self._bus: can.BusABC | None = None
        self._receiver: Receiver | None = None
        self._dropped = 0  # of those that the receiver tells, so many are counted
        self._pace = Pace()
        self._sender: Sender | None = None
        self._opening: Future[can.BusABC] | None = None
        self._closing: Future[None] | None = None
        self._backoff_s = FIRST_BACKOFF_S
        self._retry_at_s = 0.0
        self._lost_by_sending = False
        self._refused_s: float | None = None  # since when the bus takes no frame
        self._refusal_told = False
        self._silence = SilenceWatch(tell)
        self._error_frames = ErrorFrames(tell)

    @property
    def up(self) -> bool:
        """Whether the bus is open."""
        return self._bus is not None

    @property
    def times(self) -> str:
        """Whose the times of the frames are: "kernel", or "interface"; "" while the bus is away."""
        return "" if self._receiver is None else self._receiver.times

    @property
    def filtered(self) -> bool:
        """Whether the kernel leaves out frames that nobody needs: they are in no count."""
        return self._filter is not None and self._filter.used

    @property
    def mute(self) -> str | None:
        """What to look at, while nothing has come of the bus for long enough."""
        return nothing_came(self._name(), self.counts.error_frames) if self.up and self._silence.mute else None

    @property
    def file_number(self) -> int:
        """Of the file to wait for (``poll``); -1 while the bus is away, and on interfaces that have none."""
        try:
            return -1 if self._bus is None else self._bus.fileno()
        except Exception:  # noqa: BLE001  an interface may raise whatever its driver raises
            return -1

    def open(self, given_up: Callable[[], bool] = lambda: False) -> None:
        """Open the bus for the first time, unless ``given_up`` says meanwhile that it is not wanted any more.

        Raises:
            BusError: it cannot be opened, or does not answer for `OPEN_S`.
        """
        limit_s = time.monotonic() + OPEN_S
        self._opening = in_background(self._connect, "open bus")
        while not finished(self._opening, 0.1):
            if given_up():
                return
            if time.monotonic() > limit_s:
                raise BusError(f"the bus cannot be opened: no answer for {OPEN_S:g} s")
        self._use_opened()

    def receive(self, timeout_s: float) -> Frames:
        """Return the messages that wait, or wait for the first up to ``timeout_s``; none while the bus is away.

        A message comes at once, unless so many come that there is a rest from one look to the next (`Pace`).

        The columns are only valid until the next call.
        """
        if self._bus is not None:
            self._pace.rest()
        return self.look(timeout_s)

    def look(self, timeout_s: float) -> Frames:
        """As `receive`, without a rest: for those who look at several buses."""
        self._take_late_error()
        if self._bus is None and not self._reopen(timeout_s):
            return NOTHING
        assert self._receiver is not None
        try:
            frames = self._receiver.receive(timeout_s)
        except DamagedLineError as error:
            self.counts.damaged += 1
            if self.counts.damaged == 1:
                self._tell(True, f"{reason(error)} on {self._name()} was dropped; others will only be counted")
            return NOTHING
        except Exception as error:  # noqa: BLE001  an interface may raise whatever its driver raises
            self._lose(error, sending=False)
            return NOTHING
        if len(frames):
            self._count(frames)
        else:
            self._quiet(time.monotonic())
        return frames

    def _count(self, frames: Frames) -> None:
        now_s = time.monotonic()
        self._pace.looked(now_s, full=len(frames) >= MOST)
        if not self._lost_by_sending:
            self._backoff_s = FIRST_BACKOFF_S
        self.counts.received += len(frames)
        errors, bus_offs = self._error_frames.take(frames, now_s, self._name())
        self.counts.error_frames += errors
        self.counts.bus_offs += bus_offs
        if errors < len(frames):
            self._silence.heard(now_s, self._name())
            if self._filter is not None:
                self._filter.heard(frames, now_s)
        else:
            self._quiet(now_s)
        if self._receiver is not None and self._receiver.dropped != self._dropped:
            self._count_dropped(self._receiver.dropped)

    def _count_dropped(self, dropped: int) -> None:
        new, self._dropped = (dropped - self._dropped) % (1 << 32), dropped  # the kernel counts in 32 bits
        before = self.counts.dropped
        self.counts.dropped += new
        if not before:
            self._tell(
                True,
                f"{new} frames of {self._name()} were not fetched in time and lost; "
                "others are counted, and told when there are twice as many",
            )
        elif self.counts.dropped.bit_length() > before.bit_length():
            self._tell(True, f"{self.counts.dropped} frames of {self._name()} in all were not fetched in time")

    def send(self, message: can.Message) -> bool:
        """Send; false when the bus does not take it. A bus that blocks is not waited for."""
        self._take_late_error()
        if self._listen_only or (self._bus is None and not self._reopen(0.0)):
            self.counts.send_failures += 1
            return False
        assert self._sender is not None
        try:
            through = self._sender.send(message)
        except Exception as error:  # noqa: BLE001  an interface may raise whatever its driver raises
            self._not_sent(error)
            return False
        self.counts.sent += 1
        if through:
            self._sent()
        return True

    def close(self) -> None:
        """Close the bus; one that does not close within `CLOSE_S` is told and left as it is."""
        if self._opening is not None:
            self._opening.add_done_callback(_close_late)
            self._opening = None
        if self._bus is None:
            return
        name = self._name()
        if self._sender is not None:
            self._sender.close(CLOSE_S / 2)
            self._take_late_error()
        closing = self._begin_closing()
        if closing is None:  # lost at the last moment
            return
        if not finished(closing, CLOSE_S):
            self._tell(True, f"{name} does not close and is left as it is")
        elif (error := closing.exception()) is not None:
            self._tell(True, f"{name} cannot be closed: {reason(error)}")

    def _take_late_error(self) -> None:
        """Find out what became of a frame that was still under way when it was counted as sent."""
        error = None if self._sender is None else self._sender.late_error()
        if error is not None:
            self.counts.sent -= 1
            self._not_sent(error)

    def _sent(self) -> None:
        self._lost_by_sending = False
        if self._refusal_told:
            self._tell(False, f"frames can be sent again on {self._name()}")
        self._refused_s, self._refusal_told = None, False

    def _not_sent(self, error: Exception) -> None:
        self.counts.send_failures += 1
        if not is_full(error):
            self._lose(error, sending=True)
            return
        now_s = time.monotonic()
        if self._refused_s is None:
            self._refused_s = now_s
        elif not self._refusal_told and now_s - self._refused_s >= REFUSAL_S:
            self._refusal_told = True
            self._tell(True, f"no frame could be sent for {REFUSAL_S:g} s on {self._name()}: {reason(error)}")

    def _quiet(self, now_s: float) -> None:
        if self._filter is not None:
            self._filter.quiet(now_s)
        self.counts.silences += self._silence.quiet(now_s, self._name(), self.counts.error_frames)

    def _name(self) -> str:
        assert self._bus is not None
        return self._bus.channel_info

    def _lose(self, error: Exception, sending: bool) -> None:
        self.counts.lost += 1
        if self._backoff_s == FIRST_BACKOFF_S:  # tell it once, not at every try
            self._tell(True, f"the bus is gone: {reason(error)}; trying to open it again")
        self._lost_by_sending |= sending
        if self._sender is not None:
            self._sender.close(0.0)
        self._begin_closing()
        self._retry_later()

    def _retry_later(self) -> None:
        self._retry_at_s = time.monotonic() + self._backoff_s
        self._backoff_s = min(2 * self._backoff_s, LONGEST_BACKOFF_S)

    def _begin_closing(self) -> Future[None] | None:
        bus, self._bus, self._receiver, self._sender = self._bus, None, None, None
        if bus is None:
            return None
        self._refused_s, self._refusal_told = None, False
        self._closing = in_background(partial(close_bus, bus), "close bus")
        return self._closing

    def _open_again(self) -> can.BusABC:
        """Open the bus as soon as the old one is closed, whether well or not; one that does not close is left."""
        if self._closing is not None:
            finished(self._closing, CLOSE_S)
        return self._connect()

    def _use_opened(self) -> None:
        assert self._opening is not None
        opening, self._opening = self._opening, None
        try:
            self._bus = opening.result()
        except BusError:
            raise
        except Exception as error:
            raise BusError(f"the bus cannot be opened: {reason(error)}") from error
        self._receiver, self._dropped = receiver_of(self._bus), 0
        self._filter = None if self._wanted is None else KernelFilter(self._bus, self._wanted)
        self._sender = None if self._listen_only else Sender(self._bus)

    def _reopen(self, timeout_s: float) -> bool:
        if self._opening is None:
            wait_s = self._retry_at_s - time.monotonic()
            if wait_s > 0:
                time.sleep(min(wait_s, timeout_s))
                return False
            self._opening = in_background(self._open_again, "open bus")
        if not finished(self._opening, timeout_s):
            return False
        try:
            self._use_opened()
        except BusError:
            self._retry_later()
            return False
        self.counts.reconnects += 1
        self._silence.opened_again(time.monotonic())
        self._tell(False, "the bus is open again")
        return True


def _close_late(opening: Future[can.BusABC]) -> None:
    """Close a bus that opened after nobody wanted it any more; nobody is there to be told how that went either."""
    if opening.exception() is None:
        settle(Future(), partial(close_bus, opening.result()))
