"""Error frames of a bus in words: what the controller has noticed, as SocketCAN says it (linux/can/error.h)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from dctorque_can.pipeline.frames import FrameFlag, Frames

BUS_OFF = 0x40  # in the identifier of an error frame
_ACKNOWLEDGE, _CONTROLLER, _RESTARTED = 0x20, 0x04, 0x100
_CLASSES = {
    0x01: "a frame could not be sent in time",
    0x02: "arbitration was lost",
    0x08: "frames on the bus are damaged (bit rate, termination, wiring?)",
    0x10: "the transceiver reports a fault (wiring?)",
    _ACKNOWLEDGE: "nobody acknowledges what is sent (is another node on the bus, with the same bit rate?)",
    0x80: "a bus error",
    _RESTARTED: "the controller was started anew",
}
_CONTROLLER_STATES = {
    0x03: "the controller has dropped frames",
    0x0C: "many errors (warning level)",
    0x30: "so many errors that the controller is passive",
    0x40: "the controller is error active again",
}
CALM_S = 10.0  # after so long without one, error frames are told again
BUS_OFF_TEXT = (
    "bus-off: the controller has left the bus; SocketCAN brings it back by itself with "
    "`ip link set CHANNEL type can restart-ms 100`"
)


class ErrorFrames:
    """Tells the first error frame of each bout, and the first bus-off of it.

    Args:
        tell: ``tell(is_error, text)``.
    """

    def __init__(self, tell: Callable[[bool, str], None]) -> None:
        self._tell = tell
        self._latest_s = self._bus_off_s = -math.inf

    def take(self, frames: Frames, now_s: float, name: str) -> tuple[int, int]:
        """Look for error frames in a batch; return how many there are, and how many of them report bus-off."""
        if max(frames.flags.tobytes()) < FrameFlag.ERROR:  # most batches have no flags at all
            return 0, 0
        rows = np.flatnonzero((frames.flags & FrameFlag.ERROR) != 0)
        if not len(rows):
            return 0, 0
        ids = frames.can_id[rows]
        bus_offs = int(((ids & BUS_OFF) != 0).sum())
        if bus_offs and now_s - self._bus_off_s >= CALM_S:
            self._tell(True, f"{name}: {BUS_OFF_TEXT}; others will only be counted")
        elif not bus_offs and now_s - self._latest_s >= CALM_S:
            what = "; ".join(words(int(ids[0]), int(frames.data[rows[0], 1])))
            self._tell(True, f"{name}: error frames: {what}; others will only be counted")
        self._latest_s = now_s
        if bus_offs:
            self._bus_off_s = now_s
        return len(rows), bus_offs


def words(can_id: int, controller: int) -> list[str]:
    """Return what an error frame says, by its identifier and its byte 1 (state of the controller)."""
    found = [text for bit, text in _CLASSES.items() if can_id & bit]
    if can_id & BUS_OFF:
        found.append("bus-off")
    if can_id & _CONTROLLER:
        found += [text for bits, text in _CONTROLLER_STATES.items() if controller & bits]
    return found or ["of a kind that the interface does not tell"]
