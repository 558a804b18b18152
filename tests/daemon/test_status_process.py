"""The status process as a client finds it, and the service beside it: never held up, whatever clients do."""

import os
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families

from dctorque_can.daemon.status import process as status_process
from dctorque_can.daemon.status import worker as status_worker
from dctorque_can.daemon.status.client import read_status, socket_of
from dctorque_can.daemon.status.process import StatusPlaces, StatusProcess
from dctorque_can.daemon.status.worker import MOST_CLIENTS
from dctorque_can.errors import DctorqueError

SNAPSHOT = {"uptime_s": 1.0, "name": "a car"}
PATIENCE_S = 600.0


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(status_process, "OPEN_TIMEOUT_S", PATIENCE_S)
    monkeypatch.setattr(status_process, "CLOSE_S", PATIENCE_S)


class Served:
    """A status process that serves, and what it told."""

    def __init__(self, places: StatusPlaces) -> None:
        self.told: list[str] = []
        self.process = StatusProcess(places, lambda is_error, text: self.told.append(text))
        self.places = places
        self.snapshot = SNAPSHOT

    def begin(self, snapshot: dict[str, Any]) -> None:
        self.snapshot = snapshot
        self.process.begin()
        self.process.wait_until_open(lambda: False)
        self.process.publish(snapshot)
        while self.process._rest:  # a pipe takes 64 KB at a time
            self.process._write()
            time.sleep(0.001)

    @property
    def number(self) -> int:
        assert self.process._process is not None
        return self.process._process.pid

    def read(self) -> dict[str, Any]:
        """Read the status; a process that begins, or is overrun, is waited for."""
        assert self.places.socket is not None
        while True:
            try:
                return read_status(self.places.socket, PATIENCE_S)
            except DctorqueError:
                self.process.publish(self.snapshot)
                time.sleep(0.02)

    def until(self, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        while not holds(status := self.read()):
            time.sleep(0.02)
        return status


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Served]]:
    begun = []

    def begin(snapshot: dict[str, Any] = SNAPSHOT, metrics: tuple[str, int] | None = None) -> Served:
        served = Served(StatusPlaces(tmp_path / "status.sock", metrics))
        begun.append(served)
        served.begin(snapshot)
        return served

    yield begin
    for each in begun:
        each.process.close()
        assert not (tmp_path / "status.sock").exists()


@pytest.fixture
def port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


def connected(served: Served) -> socket.socket:
    client = socket.socket(socket.AF_UNIX)  # without a limit: where the queue is full it is waited for
    client.connect(str(served.places.socket))
    return client


def test_a_client_gets_the_latest_snapshot(serve: Callable[..., Served]) -> None:
    served = serve()
    served.process.publish(SNAPSHOT | {"uptime_s": 2.0})
    status = served.until(lambda status: status["uptime_s"] == 2.0)
    assert status["name"] == "a car"
    assert status["snapshot_age_s"] >= 0.0
    assert status["clients"]["dropped"] == 0


def test_clients_that_do_not_read_or_send_garbage_or_are_a_thousand_hold_up_nobody(
    serve: Callable[..., Served],
) -> None:
    served = serve(SNAPSHOT | {"long": "x" * 500_000})  # more than a socket takes at once
    idle = [connected(served) for _ in range(MOST_CLIENTS)]  # until they are dropped they are all there may be
    turned_away = connected(served)
    assert turned_away.recv(1) == b""
    turned_away.close()
    for client in idle[:5]:
        client.setblocking(False)
        with suppress(OSError):  # it is dropped already
            client.send(os.urandom(1 << 16))
    for _ in range(1000):
        connected(served).close()
    status = served.until(lambda status: status["clients"]["dropped"] >= MOST_CLIENTS)
    assert status["clients"]["turned_away"] >= 1
    for client in idle:
        client.close()
    assert served.told == []


def test_a_process_that_does_not_take_anything_costs_neither_time_nor_memory(
    serve: Callable[..., Served],
) -> None:
    served = serve()
    os.kill(served.number, signal.SIGSTOP)
    for _ in range(1000):
        served.process.publish(SNAPSHOT | {"long": "x" * 10_000})  # ten times what a pipe holds
    assert len(served.process._rest) < 11_000
    os.kill(served.number, signal.SIGCONT)
    assert served.read()["name"] == "a car"


def test_half_a_line_of_a_service_that_is_killed_is_no_matter(
    serve: Callable[..., Served], capfd: pytest.CaptureFixture[str]
) -> None:
    served = serve()
    process = served.process._process
    assert process is not None
    assert process.stdin is not None
    os.write(process.stdin.fileno(), b'{"uptime_s": 2')
    process.stdin.close()
    assert process.wait() == 0
    assert capfd.readouterr().err == ""
    assert not served.places.socket.exists()  # type: ignore[union-attr]


def test_a_process_that_is_killed_is_started_anew_and_takes_its_socket_back(
    serve: Callable[..., Served], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(status_process, "RESTART_S", 0.01)
    served = serve()
    before = served.number
    os.kill(before, signal.SIGKILL)
    while served.process._process is None or served.number == before:
        served.process.publish(SNAPSHOT)
        time.sleep(0.01)
    assert served.told == ["the status process ended with code -9 and is started anew"]
    assert served.read()["name"] == "a car"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGINT])
def test_signals_are_for_the_service_alone(serve: Callable[..., Served], number: int) -> None:
    served = serve()
    os.kill(served.number, number)
    assert served.read()["name"] == "a car"


def test_two_services_do_not_fight_over_a_socket(serve: Callable[..., Served]) -> None:
    served = serve()
    second = Served(served.places)
    second.process.begin()
    with pytest.raises(DctorqueError, match="another service serves there"):
        second.process.wait_until_open(lambda: False)
    assert served.read()["name"] == "a car"


def test_a_service_that_need_not_be_read_tells_why_it_cannot_be_and_tries_again(
    serve: Callable[..., Served],
) -> None:
    first = serve()
    second = Served(first.places)
    second.snapshot = SNAPSHOT | {"name": "another car"}
    second.process.begin()
    while not second.told:
        second.process.publish(second.snapshot)
        time.sleep(0.02)
    (line,) = second.told
    assert "another service serves there" in line
    assert "tried again" in line
    first.process.close()
    assert second.until(lambda status: status["name"] == "another car")
    second.process.close()


def asked(port: int, request: bytes) -> bytes:
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as client:
        client.sendall(request)
        answer = b""
        while chunk := client.recv(1 << 16):
            answer += chunk
        return answer


def test_prometheus_is_answered_and_nobody_else(serve: Callable[..., Served], port: int) -> None:
    served = serve({}, ("127.0.0.1", port))
    head, _, body = asked(port, b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n").partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200 OK\r\n")
    names = [family.name for family in text_string_to_metric_families(body.decode())]
    assert names == ["dctorque_up", "dctorque_status_clients"]
    assert asked(port, b"GET / HTTP/1.1\r\n\r\n").startswith(b"HTTP/1.1 404 ")
    for garbage in (b"POST /metrics HTTP/1.1\r\n\r\n", b"\xff\xfe\r\n\r\n", b"GET /metrics\r\n\r\n"):
        assert asked(port, garbage).startswith(b"HTTP/1.1 400 ")
    silent = socket.create_connection(("127.0.0.1", port), PATIENCE_S)  # that long it is waited for
    begun_s = time.monotonic()
    assert silent.recv(1) == b""
    assert time.monotonic() - begun_s >= 0.9 * status_worker.CLIENT_S
    silent.close()
    served.process.publish(SNAPSHOT)
    clients = served.until(lambda status: status["clients"]["dropped"] == 1)["clients"]
    assert clients["garbage"] == 3


def test_the_head_of_a_request_has_an_end(serve: Callable[..., Served], port: int) -> None:
    serve({}, ("127.0.0.1", port))
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as client:
        client.setblocking(True)
        try:
            for _ in range(1000):
                client.sendall(b"GET /metrics HTTP/1.1\r\nX: " + b"a" * 10_000)
            pytest.fail("takes whatever is sent")
        except ConnectionError:
            pass


def test_a_port_that_is_taken_is_told_with_its_address(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        served = Served(StatusPlaces(None, ("127.0.0.1", port)))
        served.process.begin()
        with pytest.raises(DctorqueError, match=f"status: 127.0.0.1:{port}: .*in use"):
            served.process.wait_until_open(lambda: False)


def test_a_client_is_told_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(DctorqueError, match="no such socket: does the service run"):
        read_status(tmp_path / "nothing")
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(tmp_path / "dead"))
    with pytest.raises(DctorqueError, match="nobody serves there any more"):
        read_status(tmp_path / "dead")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "too many clients"),
        (b"\xff\x00", "is no status"),
        (b"[" * 100_000, "is no status"),
        (b"[1]", "is no status"),
        (b'{"clients": {}}', "starts and has no status yet"),
    ],
)
def test_a_client_believes_nothing_that_is_no_status(tmp_path: Path, content: bytes, told: str) -> None:
    import threading

    path = tmp_path / "status.sock"
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        server.listen()

        def serve_once() -> None:
            client, _ = server.accept()
            with client:
                client.sendall(content)

        thread = threading.Thread(target=serve_once)
        thread.start()
        with pytest.raises(DctorqueError, match=told):
            read_status(path)
        thread.join()


def test_a_service_is_found_by_its_name(tmp_path: Path) -> None:
    assert socket_of("mycar", tmp_path) == tmp_path / "mycar" / "status.sock"
    with pytest.raises(DctorqueError, match="no service has a socket"):
        socket_of(None, tmp_path)
    for name in ("mycar", "yours"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "status.sock").touch()
        if name == "mycar":
            assert socket_of(None, tmp_path) == tmp_path / "mycar" / "status.sock"
    with pytest.raises(DctorqueError, match="several services run \\(mycar, yours\\)"):
        socket_of(None, tmp_path)
    for path in ("../mycar", "..", ""):
        with pytest.raises(DctorqueError, match="the name of an instance"):
            socket_of(path, tmp_path)
