"""What python-can's slcan interface needs to survive adapters that are reset, unplugged, or stop reading."""

from __future__ import annotations

import re
import select
from contextlib import closing
from typing import Any

import can
from can.interfaces.slcan import slcanBus
from can.util import CAN_FD_DLC

from dctorque_can.daemon.wire.opening import DamagedLineError
from dctorque_can.daemon.wire.sender import SEND_S

LONGEST_LINE = 256  # a frame of CAN FD with a time stamp has 147 characters

_FRAME = re.compile(
    r"(?:[trdb][0-7][0-9A-F]{2}|[TRDBx][01][0-9A-F]{7})(?P<dlc>[0-9A-F])(?P<rest>(?:[0-9A-F]{2})*)\r",
    re.IGNORECASE,
)
_ANSWER = re.compile(r"(?:[zZ]|[VvNFA][0-9A-Za-z]*)?[\r\a]")  # taken, not taken, version, serial number, flags
_STAMPS = (0, 4, 8)  # digits of an optional time stamp


class SturdySlcanBus(slcanBus):
    """As python-can's, for adapters as they are.

    Reading raises `DamagedLineError` where python-can would raise anything else or give a frame that never was.
    Writing raises `can.CanTimeoutError` after `SEND_S` when the adapter does not read: also the commands that open
    and close, for which python-can has no limit. Closing gives the port back even when the adapter is gone.
    """

    _full = False

    def __init__(self, *arguments: Any, **options: Any) -> None:
        try:
            super().__init__(*arguments, **options)
        except BaseException:
            if (port := getattr(self, "serialPortOrig", None)) is not None:
                port.close()
            raise
        self.channel_info = f"slcan:{self.serialPortOrig.port}"

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: D102
        super().send(msg, SEND_S)

    def shutdown(self) -> None:  # noqa: D102
        with closing(self.serialPortOrig):
            if (
                self._full
            ):  # or the kernel would wait for the adapter for half a minute, also when the process ends
                self.serialPortOrig.reset_output_buffer()
            super().shutdown()

    def _write(self, string: str) -> None:
        port = self.serialPortOrig
        if port.write_timeout != SEND_S:
            port.write_timeout = SEND_S
        descriptor = getattr(port, "fd", None)  # of a serial port of POSIX
        # pyserial keeps to its limit too, but asks the kernel without a pause meanwhile.
        self._full = descriptor is not None and not select.select([], [descriptor], [], SEND_S)[1]
        if self._full:
            raise can.CanTimeoutError("the adapter takes no more")
        try:
            super()._write(string)
        except can.CanOperationError as error:
            self._full = type(error.__cause__).__name__ == "SerialTimeoutException"
            if self._full:
                raise can.CanTimeoutError("the adapter takes no more") from error
            raise

    def _read(self, timeout: float | None) -> str | None:
        try:
            line = super()._read(timeout)
        except can.CanOperationError as error:
            if isinstance(error.__cause__, UnicodeDecodeError):
                raise self._damaged() from error
            raise
        if len(self._buffer) > LONGEST_LINE if line is None else not is_whole(line):
            raise self._damaged()
        return line

    def _damaged(self) -> DamagedLineError:
        self._buffer.clear()  # python-can would find what it cannot decode again and again
        return DamagedLineError("a damaged line of the slcan adapter")


def is_whole(line: str) -> bool:
    """Return whether a line, with its end, is a frame or an answer."""
    frame = _FRAME.fullmatch(line)
    if frame is None:
        return _ANSWER.fullmatch(line) is not None
    dlc = int(frame["dlc"], 16)
    kind = line[0]
    if kind not in "dDbB" and dlc > 8:
        return False
    digits = 0 if kind in "rR" else 2 * CAN_FD_DLC[dlc]
    return len(frame["rest"]) - digits in _STAMPS
