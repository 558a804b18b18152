"""What waits on a bus, as columns, whatever its interface."""

from __future__ import annotations

from typing import Protocol, cast

import can
from can.interfaces.socketcan import SocketcanBus

from dctorque_can.daemon.wire.socketcan import MOST, SocketcanReceiver
from dctorque_can.logs.messages import MessageRoom
from dctorque_can.pipeline.frames import Frames

NOTHING = Frames.empty()


class Receiver(Protocol):
    """Receives from one bus.

    Attributes:
        dropped: frames that were dropped before the service could fetch them, as far as the system tells.
        times: whose the times of the frames are: "kernel", or "interface": what python-can's driver says.
    """

    dropped: int
    times: str

    def receive(self, timeout_s: float) -> Frames:
        """Return what waits, `MOST` frames at most, or wait for the first up to ``timeout_s``.

        The columns are only valid until the next call.

        Raises:
            Exception: whatever the interface raises.
        """


class MessageReceiver:
    """Receives by python-can's own ``recv``, message by message.

    Args:
        bus: any bus.
    """

    dropped = 0  # python-can does not say
    times = "interface"

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._room = MessageRoom(MOST)
        self._late_error: Exception | None = None

    def receive(self, timeout_s: float) -> Frames:
        """See `Receiver`. An error behind a message is raised by the next call."""
        if self._late_error is not None:
            error, self._late_error = self._late_error, None
            raise error
        recv = self._bus.recv
        message = recv(timeout_s)
        if message is None:
            return NOTHING
        messages = [message]
        try:
            while len(messages) < MOST and (message := recv(0.0)) is not None:
                messages.append(message)
        except Exception as error:  # noqa: BLE001  an interface may raise whatever its driver raises
            self._late_error = error
        return self._room.frames(messages)


def receiver_of(bus: can.BusABC) -> Receiver:
    """Return the quickest way to receive from a bus."""
    if SocketcanReceiver.fits(bus):
        return SocketcanReceiver(cast(SocketcanBus, bus))
    return MessageReceiver(bus)
