"""Receiving with a time limit that holds when the system clock is set."""

from __future__ import annotations

import time

import can


def receive_by_steady_clock(bus: can.BusABC) -> None:
    """Let ``bus.recv`` keep its time limit by a clock that nobody sets.

    `can.BusABC.recv` subtracts two readings of the system clock. When that is set back by an hour while it waits
    on a silent bus, it waits for an hour: the service could neither stop nor tell that it lives.
    """
    if type(bus).recv is not can.BusABC.recv:  # the interface has a way of its own
        return

    def recv(timeout: float | None = None) -> can.Message | None:
        until_s = time.monotonic() + timeout if timeout else None
        left_s = timeout
        while True:
            message, filtered = bus._recv_internal(left_s)
            if message is not None and (filtered or bus._matches_filters(message)):
                return message
            if timeout == 0:  # what is filtered out has used up the time
                return None
            if until_s is not None:
                left_s = until_s - time.monotonic()
                if left_s <= 0:
                    return None

    bus.recv = recv  # type: ignore[method-assign]
