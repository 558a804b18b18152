"""The status process: keeps the latest snapshot of the service and gives it to whoever connects.

It is a process of its own so that the receive loop never feels a client: whatever a client does, the loop writes a
line into a pipe once a second, and where the pipe is full it does not even that. Nothing that a client sends is
read, but for the head of an HTTP request. A client gets `CLIENT_S`; of more than `MOST_CLIENTS` at once the others
are let go. It ends when the pipe does.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from dctorque_can.daemon.status.listener import StatusError, identity, listen, remove
from dctorque_can.daemon.status.metrics import CONTENT_TYPE, metrics_text

CLIENT_S = 2.0
MOST_CLIENTS = 16
LONGEST_LINE = 1 << 20  # of a snapshot
LONGEST_HEAD = 4096  # of an HTTP request
_FIRST_PAUSE_S = 0.2
_LONGEST_PAUSE_S = 60.0
_QUIET_S = 1.0  # that long a failure may be one that passes: a service that was killed has a status process yet

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class StatusWorker:
    """Serves the latest snapshot.

    Attributes:
        latest: snapshot, None before the first.
        clients: how many were answered, let go because they did not take it (``dropped``), let go because there
            were too many (``turned_away``), and how many sent what is no request for metrics (``garbage``).
    """

    def __init__(self) -> None:
        self.latest: dict[str, Any] | None = None
        self.clients = {"answered": 0, "dropped": 0, "turned_away": 0, "garbage": 0}
        self._came_s = 0.0
        self._now = 0

    def take(self, line: bytes) -> None:
        """Take the next snapshot."""
        self.latest = json.loads(line)
        self._came_s = time.monotonic()

    def snapshot(self) -> dict[str, Any]:
        """Return the latest snapshot with its age and what became of the clients."""
        age_s = time.monotonic() - self._came_s
        return {**(self.latest or {}), "snapshot_age_s": round(age_s, 3), "clients": dict(self.clients)}

    async def on_socket(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Give a client of the Unix socket the snapshot as one line of JSON."""

        async def answer() -> bytes:
            return json.dumps(self.snapshot()).encode() + b"\n"

        await self._serve(writer, answer)

    async def on_port(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer an HTTP request for /metrics."""

        async def answer() -> bytes:
            try:
                head = await reader.readuntil(b"\r\n\r\n")
            except (asyncio.LimitOverrunError, asyncio.IncompleteReadError):
                head = b""
            words = head.split(b"\r\n", 1)[0].split(b" ")
            if len(words) != 3 or words[0] != b"GET" or not words[2].startswith(b"HTTP/1."):
                self.clients["garbage"] += 1
                return _http("400 Bad Request", "only GET\n")
            if words[1] != b"/metrics":
                return _http("404 Not Found", "there is /metrics\n")
            return _http("200 OK", metrics_text(self.snapshot()))

        await self._serve(writer, answer)

    async def _serve(self, writer: asyncio.StreamWriter, answer: Callable[[], Awaitable[bytes]]) -> None:
        if self._now >= MOST_CLIENTS:
            self.clients["turned_away"] += 1
            writer.transport.abort()
            return
        self._now += 1
        try:
            async with asyncio.timeout(CLIENT_S):
                writer.write(await answer())
                writer.close()
                await writer.wait_closed()
        except (TimeoutError, ConnectionError):
            self.clients["dropped"] += 1
            writer.transport.abort()
        except asyncio.CancelledError:  # the process ends
            writer.transport.abort()
        else:
            self.clients["answered"] += 1
        finally:
            self._now -= 1


def _http(status: str, body: str) -> bytes:
    content = body.encode()
    kind = CONTENT_TYPE if status.startswith("200") else "text/plain; charset=utf-8"
    head = (
        f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(content)}\r\nConnection: close\r\n\r\n"
    )
    return head.encode() + content


def _report(**content: Any) -> None:
    """Tell the service; one that is dead needs no telling."""
    with suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), json.dumps(content).encode() + b"\n")


async def _begin(name: str, begin: Callable[[], Awaitable[Any]]) -> Any:
    """Begin to listen somewhere; try again and again, and tell each reason once."""
    pause_s, told, since_s = _FIRST_PAUSE_S, "", time.monotonic()
    while True:
        try:
            result = await begin()
        except (OSError, StatusError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            if reason != told and time.monotonic() - since_s >= _QUIET_S:
                told = reason
                _report(failed=name, reason=reason)
        else:
            _report(listening=name)
            return result
        await asyncio.sleep(pause_s)
        pause_s = min(2 * pause_s, _LONGEST_PAUSE_S) if told else pause_s


async def _serve(setup: dict[str, Any], lines: asyncio.StreamReader, worker: StatusWorker) -> None:
    path = Path(setup["socket"]) if setup["socket"] is not None else None
    ours: list[tuple[int, int]] = []

    async def begin_socket() -> None:
        assert path is not None
        listener = listen(path)
        ours[:] = [identity(path)]
        await asyncio.start_unix_server(worker.on_socket, sock=listener, limit=LONGEST_HEAD)

    async def begin_port() -> None:
        host, port = setup["metrics"]
        await asyncio.start_server(worker.on_port, host, port, limit=LONGEST_HEAD)

    beginning = []
    if path is not None:
        beginning.append(asyncio.create_task(_begin(str(path), begin_socket)))
    if setup["metrics"] is not None:
        beginning.append(asyncio.create_task(_begin("{}:{}".format(*setup["metrics"]), begin_port)))
    try:
        while (line := await lines.readline()).endswith(b"\n"):  # a killed service may leave half a line
            worker.take(line)
    finally:
        for task in beginning:
            task.cancel()
        if path is not None and ours:
            with suppress(OSError, StatusError):  # the next service replaces what is left of this one
                remove(path, ours[0])


async def _main() -> None:
    loop = asyncio.get_running_loop()
    lines = asyncio.StreamReader(limit=LONGEST_LINE)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin.buffer)
    first = await lines.readline()
    if first.endswith(b"\n"):
        await _serve(json.loads(first), lines, StatusWorker())


def main() -> None:
    """Serve until standard input ends; the first line of it says where."""
    for unwanted in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1):
        signal.signal(unwanted, signal.SIG_IGN)  # the end of the pipe is what ends this process
    asyncio.run(_main())


if __name__ == "__main__":
    main()
