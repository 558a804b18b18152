"""A server of python-can-remote over loopback, in a process of its own, that is killed and started again."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator

import can
import pytest

from dctorque_can.daemon.wire.link import BusLink, open_bus

from .test_link import MESSAGE

pytest.importorskip("can_remote", reason="python-can-remote is not installed")


class Server:
    """Serves a virtual bus, and plays a car on it: all that it has sent comes back."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        options = ["-i", "virtual", "-c", "remote test", "-H", "127.0.0.1", "-p", str(self.port)]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "can_remote", *options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), 1.0).close()
            except OSError:
                assert self.process.poll() is None
                time.sleep(0.05)
            else:
                return

    def kill(self) -> None:
        assert self.process is not None
        self.process.kill()
        self.process.wait()


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.kill()


def test_a_server_that_is_killed_and_comes_back(server: Server) -> None:
    told: list[str] = []
    arguments = {"interface": "remote", "channel": f"ws://127.0.0.1:{server.port}/"}

    def connect() -> can.BusABC:
        return open_bus(arguments)

    link = BusLink(connect, lambda is_error, text: told.append(text))
    link.open()
    with open_bus(arguments) as car:
        car.send(MESSAGE)
        assert receive(link) == MESSAGE.arbitration_id
    server.kill()
    while link.up:
        link.receive(0.05)
    assert [line.startswith("the bus is gone: ") for line in told] == [True]
    for _ in range(3):
        assert not link.send(MESSAGE)
    server.start()
    while not link.up:
        link.receive(0.05)
    assert told[1:] == ["the bus is open again"]
    with open_bus(arguments) as car:
        car.send(MESSAGE)
        assert receive(link) == MESSAGE.arbitration_id
        assert link.send(MESSAGE)
        heard = None
        while heard is None:
            heard = car.recv(0.1)
    assert heard.arbitration_id == MESSAGE.arbitration_id
    link.close()


def receive(link: BusLink) -> int:
    while True:
        frames = link.receive(0.05)
        if len(frames):
            return int(frames.can_id[0])
