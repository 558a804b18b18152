"""Who gets the socket of the status, and what is left alone."""

import os
import socket
import stat
from pathlib import Path

import pytest

from dctorque_can.daemon.status import listener as status_socket
from dctorque_can.daemon.status.listener import StatusError, identity, listen, remove


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "status.sock"


def test_user_and_group_may_use_it_and_nobody_else(path: Path) -> None:
    with listen(path):
        assert stat.S_IMODE(path.lstat().st_mode) == 0o660


def test_a_socket_of_a_dead_process_is_replaced(path: Path) -> None:
    listen(path).close()
    with listen(path), socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))


def test_a_socket_of_a_living_process_is_not_taken(path: Path) -> None:
    with listen(path):
        before = identity(path)
        with pytest.raises(StatusError, match="another service serves there"):
            listen(path)
        assert identity(path) == before


def test_a_socket_whose_queue_is_full_is_not_taken(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(status_socket, "_PROBE_S", 0.01)
    with listen(path):
        clients = []
        try:
            while True:
                clients.append(socket.socket(socket.AF_UNIX))
                clients[-1].setblocking(False)
                clients[-1].connect(str(path))
        except BlockingIOError:
            pass
        with pytest.raises(StatusError, match="somebody has this socket"):
            listen(path)
        for client in clients:
            client.close()


@pytest.mark.parametrize("kind", ["link to nothing", "link to a socket", "file", "datagram"])
def test_what_is_no_socket_of_a_service_is_left_alone(path: Path, kind: str, tmp_path: Path) -> None:
    target = tmp_path / "target"
    if kind == "link to a socket":
        listen(target).close()
    if kind.startswith("link"):
        path.symlink_to(target)
    elif kind == "file":
        path.write_text("mine")
    else:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
            other.bind(str(path))
            with pytest.raises(StatusError):
                listen(path)
        return
    there = target.exists()
    with pytest.raises(StatusError, match="symbolic link" if kind.startswith("link") else "is a file"):
        listen(path)
    assert path.is_symlink() == kind.startswith("link")
    assert target.exists() == there


def test_a_folder_that_somebody_holds_locked_is_not_waited_for_for_ever(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fcntl

    monkeypatch.setattr(status_socket, "_LOCK_S", 0.05)
    holder = os.open(path.parent, os.O_RDONLY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    with pytest.raises(StatusError, match="locked"):
        listen(path)
    os.close(holder)


def test_only_its_own_socket_is_removed(path: Path) -> None:
    with listen(path):
        ours = identity(path)
        path.rename(path.with_name("kept, so that its number is not given away"))
        with listen(path):
            remove(path, ours)
            assert path.exists()
            remove(path, identity(path))
            assert not path.exists()
            remove(path, ours)  # gone already
