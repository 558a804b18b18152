"""Notices an interface that has lost its device or server and does not say so."""

from __future__ import annotations

import time
from typing import Any

import can

SPIN_RETURNS = 100
SPIN_S = 0.02


def raise_on_spin(bus: can.BusABC) -> None:
    """Make receiving raise when the interface returns at once, without a message, again and again.

    After its server has closed the connection, python-can's socketcand interface finds an empty read where it
    waits for data: it returns at once instead of after the timeout, and `can.BusABC.recv` calls it again in a loop
    that takes a whole processor and never raises. Taken for lost are `SPIN_RETURNS` returns in a row in less than
    `SPIN_S` (and than a tenth of the time that they were given): 0.2 ms each, quicker than an interface that polls
    with pauses. A silent bus, whose interface waits for its timeout, is never taken for lost.
    """
    inner = bus._recv_internal
    ended = "the interface no longer waits for frames; its other end has closed"
    returns, given_s, since_s = 0, 0.0, 0.0

    def watched(timeout: float | None) -> Any:
        nonlocal returns, given_s, since_s
        result = inner(timeout)
        if result[0] is not None:
            returns = 0
            return result
        if timeout is None or timeout <= 0:  # asked not to wait
            return result
        if returns == 0:
            given_s, since_s = 0.0, time.monotonic()
        returns += 1
        given_s += timeout
        if returns > SPIN_RETURNS:
            took_s = time.monotonic() - since_s
            returns = 0
            if took_s < min(SPIN_S, 0.1 * given_s):
                raise can.CanOperationError(ended)
        return result

    bus._recv_internal = watched  # type: ignore[method-assign]
