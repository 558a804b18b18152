"""A socketcand server over loopback: busy, hung, deaf, talking nonsense."""

import socket
import threading
from collections.abc import Callable, Iterator

import can
import pytest

from dctorque_can.daemon.wire import link as link_module
from dctorque_can.daemon.wire import opening, sender, socketcand
from dctorque_can.daemon.wire.link import BusError, BusLink, open_bus

from .test_link import MESSAGE

FRAME = b"< frame 123 1.5 0102 >"


class Server:
    """Accepts one client after the other and answers each of its words by what ``answers`` says next."""

    def __init__(self, answers: list[bytes | None]) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.answers = answers
        self.clients: list[socket.socket] = []
        self.ready = threading.Event()
        self.arguments = {
            **{"interface": "socketcand", "channel": "vcan0", "host": "127.0.0.1"},
            "port": self._listener.getsockname()[1],
        }
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self.clients.append(client)
            client.sendall(b"< hi >")
            for answer in self.answers:
                if not client.recv(256):
                    break  # it only looked whether somebody is there
                if answer is None:
                    break
                client.sendall(answer)
            else:
                self.ready.set()

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()
        for client in self.clients:
            client.close()


@pytest.fixture
def serve(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Server]]:
    monkeypatch.setattr(opening, "PROBE_S", None)  # the server answers, be it late
    started: list[Server] = []

    def serve(*answers: bytes | None) -> Server:
        started.append(Server(list(answers)))
        return started[-1]

    yield serve
    for server in started:
        server.close()


@pytest.fixture
def told() -> list[str]:
    return []


def open_link(server: Server, told: list[str]) -> BusLink:
    link = BusLink(lambda: open_bus(server.arguments), lambda is_error, text: told.append(text))
    link.open()
    server.ready.wait()
    return link


def receive(link: BusLink, count: int) -> list[int]:
    found: list[int] = []
    while len(found) < count:
        found += link.receive(0.05).can_id.tolist()
    return found


def test_frames_right_behind_an_answer_are_no_part_of_it(serve: Callable[..., Server], told: list[str]) -> None:
    """On a busy bus they come in one packet; python-can took them for a wrong answer and gave up."""
    link = open_link(serve(b"< ok >", b"< ok >" + 3 * FRAME), told)
    assert receive(link, 3) == [0x123] * 3
    link.close()
    assert told == []


def test_frames_before_an_answer_are_frames(serve: Callable[..., Server], told: list[str]) -> None:
    link = open_link(serve(b"< ok >" + FRAME, 2 * FRAME + b"< ok >"), told)
    assert receive(link, 3) == [0x123] * 3
    link.close()


def test_a_server_that_speaks_something_else_is_one_clear_error(serve: Callable[..., Server]) -> None:
    with pytest.raises(BusError, match="does not speak socketcand"):
        open_bus(serve(b"220 ready " * 100).arguments)


def test_an_answer_may_come_in_pieces(serve: Callable[..., Server], told: list[str]) -> None:
    server = serve(b"< o", b"k >< ok >" + FRAME)
    bus = threading.Thread(target=lambda: told.append(str(open_bus(server.arguments).shutdown())), daemon=True)
    bus.start()
    while len(server.clients) < 2:  # one looked whether somebody is there
        bus.join(0.01)
    server.clients[-1].sendall(b"k >< ok >")
    bus.join()
    assert told == ["None"]


def test_nonsense_is_dropped_and_counted(serve: Callable[..., Server], told: list[str]) -> None:
    server = serve(b"< ok >", b"< ok >")
    link = open_link(server, told)
    for n, nonsense in enumerate(
        [b"< frame XYZ 1.0 00 >", b"< frame 123 >", b"< frame 123 1.0 0g >", b"< frame 123 1.0 \xff\xfe >"]
    ):
        server.clients[-1].sendall(nonsense)
        while link.counts.damaged <= n:
            link.receive(0.05)
        server.clients[-1].sendall(FRAME)
        assert receive(link, 1) == [0x123]
    assert (link.counts.damaged, link.counts.lost) == (4, 0)
    (line,) = told
    assert line.startswith("a damaged message of the socketcand server on socketcand on vcan0@")
    link.close()


def test_a_server_that_does_not_answer_is_given_up(
    serve: Callable[..., Server], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socketcand, "HANDSHAKE_S", 0.05)
    with pytest.raises(BusError, match=r"cannot be opened: .*timed out"):
        open_bus(serve(b"< ok >", None).arguments)


def test_a_server_that_answers_otherwise_is_one_clear_error(serve: Callable[..., Server]) -> None:
    with pytest.raises(BusError, match="the server answers < error no such bus > instead of < ok >"):
        open_bus(serve(b"< error no such bus >").arguments)


def test_a_server_that_closes_while_it_is_opened_is_one_clear_error(serve: Callable[..., Server]) -> None:
    server = serve(b"< ok >", None)
    waiting = threading.Event()

    def close() -> None:
        while len(server.clients) < 2:
            waiting.wait(0.01)
        server.clients[-1].shutdown(socket.SHUT_RDWR)

    threading.Thread(target=close, daemon=True).start()
    with pytest.raises(BusError, match="cannot be opened: "):
        open_bus(server.arguments)


def test_a_server_that_reads_nothing_is_told_and_closed_all_the_same(
    serve: Callable[..., Server], told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The connection takes some hundred kilobytes and then no more; frames still come in."""
    monkeypatch.setattr(sender, "PATIENCE_S", 1.0)
    monkeypatch.setattr(link_module, "REFUSAL_S", 0.0)
    server = serve(b"< ok >", b"< ok >")
    link = open_link(server, told)
    for end in (server.clients[-1], link._bus._raw):  # type: ignore[union-attr]
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    while link.send(MESSAGE):
        pass
    while not told:
        assert not link.send(MESSAGE)
    assert told[0].startswith("no frame could be sent")
    server.clients[-1].sendall(FRAME)
    assert receive(link, 1) == [0x123]
    assert link.counts.lost == 0
    waiting = link._sender._under_way  # type: ignore[union-attr]
    link.close()
    assert waiting is not None
    assert isinstance(waiting.exception(timeout=900), OSError)  # its thread has ended


def test_a_server_that_is_gone_while_something_is_sent(serve: Callable[..., Server], told: list[str]) -> None:
    server = serve(b"< ok >", b"< ok >")
    link = open_link(server, told)
    server.clients[-1].close()
    while link.up:
        link.send(MESSAGE)
    assert link.counts.lost == 1
    assert told[0].startswith("the bus is gone: ")
    assert "\n" not in told[0]
    assert "Traceback" not in told[0]
    server.ready.clear()
    while not link.up:
        link.receive(0.05)
    server.ready.wait()
    server.clients[-1].sendall(FRAME)
    assert receive(link, 1) == [0x123]
    assert link.send(MESSAGE)
    link.close()


def test_the_interface_is_ours() -> None:
    assert can.interfaces.BACKENDS["socketcand"] == opening.STURDY["socketcand"]
