"""What python-can's socketcand interface needs to survive servers that are busy, hang, or talk nonsense."""

from __future__ import annotations

import socket
from contextlib import suppress
from typing import Any

import can
from can.interfaces.socketcand import SocketCanDaemonBus
from can.interfaces.socketcand.socketcand import convert_ascii_message_to_can_message

from dctorque_can.daemon.wire.opening import DamagedLineError, reason

HANDSHAKE_S = 5.0  # that long the server may take for an answer
LONGEST_MESSAGE = 256


class SturdySocketcandBus(SocketCanDaemonBus):
    """As python-can's, for servers as they are.

    Reading raises `DamagedLineError` for what is no frame; python-can would find it again and again. Opening takes
    an answer of the server for what it is also when frames come right behind it, as they do on a busy bus, and
    does not wait for one for ever. Closing ends a sending that waits for the server.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        try:
            super().__init__(*arguments, **options)  # type: ignore[no-untyped-call]
        except BaseException:
            if (raw := self._raw) is not None:
                raw.close()
            raise

    def shutdown(self) -> None:  # noqa: D102
        if (raw := self._raw) is not None:
            with suppress(OSError):  # the server has closed it already
                raw.shutdown(socket.SHUT_RDWR)
        super().shutdown()  # type: ignore[no-untyped-call]

    @property
    def _raw(self) -> socket.socket | None:
        """The connection, which python-can keeps for itself."""
        return getattr(self, "_SocketCanDaemonBus__socket", None)

    def _expect_msg(self, msg: str) -> None:
        raw = self._raw
        assert raw is not None
        raw.settimeout(HANDSHAKE_S)
        while (answer := _one_message(raw)).startswith("< frame "):
            message = convert_ascii_message_to_can_message(answer)
            message.channel = self.channel
            self._SocketCanDaemonBus__message_buffer.append(message)  # type: ignore[attr-defined]
        raw.settimeout(None)
        if answer != msg:
            raise can.CanOperationError(f"the server answers {answer} instead of {msg}")

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            result: tuple[can.Message | None, bool] = super()._recv_internal(timeout)  # type: ignore[no-untyped-call]
        except can.CanError as error:
            cause = error.__cause__
            if isinstance(cause, ValueError | IndexError):  # numbers that are none, bytes that are no text
                self._SocketCanDaemonBus__receive_buffer = ""
                raise DamagedLineError("a damaged message of the socketcand server") from error
            raise can.CanOperationError(reason(cause or error)) from error  # python-can's own text is a traceback
        return result


def _one_message(raw: socket.socket) -> str:
    """Read one message, and not a byte more: what follows may be frames."""
    message = b""
    while not message.endswith(b">"):
        byte = raw.recv(1)
        if not byte or len(message) > LONGEST_MESSAGE:
            raise can.CanOperationError("the server has closed the connection, or does not speak socketcand")
        message += byte
    return message.decode("ascii", "replace").strip()
