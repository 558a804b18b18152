"""Faults of a real SocketCAN bus, and a service on it that must not be heard.

Needs vcan0 and vcan1: ``tools/with-vcan pytest -m socketcan`` where the kernel has none.
"""

import subprocess
import threading
import time

import can
import pytest

from dctorque_can.daemon.wire.link import BusLink, open_bus
from dctorque_can.daemon.wire.listening import ListenOnlyError

from .test_socketcan import CAR, Daemon, inject, sent_by, set_link, start  # noqa: F401  fixtures

pytestmark = pytest.mark.socketcan

VCAN0 = {"interface": "socketcan", "channel": "vcan0"}
MESSAGE = can.Message(arbitration_id=0x100, data=b"\1", is_extended_id=False)


def test_a_service_that_listens_only_is_not_heard_on_the_wire(
    command: list[str],
    environment: dict[str, str],
    tmp_path,
    inject,  # noqa: F811
) -> None:
    """Every frame on the wire is the car's, although the vehicle file enables the output."""
    car = [*CAR, "--set", "output.enabled=true", "--listen-only"]
    heard: list[can.Message] = []
    end = threading.Event()
    with open_bus(VCAN0) as ear:

        def listen() -> None:
            while not end.is_set():
                if (message := ear.recv(0.1)) is not None:
                    heard.append(message)

        thread = threading.Thread(target=listen)
        thread.start()
        daemon = Daemon(command, environment, tmp_path, "live.mcap", car)
        daemon.read_until("only listening to socketcan:vcan0")
        daemon.read_until("its controller acknowledges the frames of others unless it was set up by")
        err = sent_by(inject(3))
        summary = daemon.stop()
        end.set()
        thread.join()
    assert "1200 frames sent, 0 not taken" in err
    assert summary["frames"] == len(heard) == 1200
    assert summary["estimates"] > 0
    assert (summary["published"], summary["output"]) == (0, None)
    assert max(message.arbitration_id for message in heard) < 0x6F0


def test_a_socket_that_only_listens_refuses() -> None:
    with open_bus(VCAN0, listen_only=True) as bus, open_bus(VCAN0) as ear:
        with pytest.raises(ListenOnlyError):
            bus.send(MESSAGE)
        assert ear.recv(0.2) is None


def test_an_interface_that_is_renamed_is_gone_until_it_has_its_name_again() -> None:
    told: list[str] = []
    link = BusLink(lambda: open_bus(VCAN0), lambda is_error, text: told.append(text))
    link.open()
    set_link("down")
    rename("vcan0", "other0")
    try:
        subprocess.run(["ip", "link", "set", "other0", "up"], check=True)
        while link.up:
            link.receive(0.1)
        for _ in range(10):
            assert len(link.receive(0.1)) == 0
            assert not link.send(MESSAGE)
        assert [line.startswith("the bus is gone") for line in told] == [True]
    finally:
        subprocess.run(["ip", "link", "set", "other0", "down"], check=True)
        rename("other0", "vcan0")
        set_link("up")
    while not link.up:
        link.receive(0.1)
    assert told[1] == "the bus is open again"
    assert link.send(MESSAGE)
    link.close()


def rename(old: str, new: str) -> None:
    subprocess.run(["ip", "link", "set", old, "name", new], check=True)


def test_an_identifier_that_someone_else_used_once_is_sent_again(
    command: list[str],
    environment: dict[str, str],
    tmp_path,
    inject,  # noqa: F811
) -> None:
    taken = 0x6F0
    car = [*CAR, "--set", "output.enabled=true", "--set", "output.foreign_silence_s=1", "--wait"]
    daemon = Daemon(command, environment, tmp_path, "live.mcap", car)
    with can.Bus(**VCAN0) as other:
        other.send(can.Message(arbitration_id=taken, data=bytes(8), is_extended_id=False))
        daemon.read_until("someone else sends on 0x6F0")
        injector = inject(60)
        daemon.read_until("nobody else sends on 0x6F0 any more")
        limit = time.monotonic() + 900
        while (message := other.recv(1.0)) is None or message.arbitration_id != taken:
            assert time.monotonic() < limit
    summary = daemon.stop()
    injector.kill()
    injector.communicate()
    assert summary["refused_ids"] == []
    assert summary["output"]["foreign_ids"] == {"6F0": {"frames": 1, "refusals": 1, "refused": False}}
    assert summary["output"]["cycles"]["DctClutchTorque"]["intervals"] > 0


def test_a_bus_that_never_says_anything_and_one_of_another_car(
    command: list[str], environment: dict[str, str], tmp_path
) -> None:
    daemon = Daemon(command, environment, tmp_path, "live.mcap", [*CAR, "--wait"])
    daemon.read_until("no frame at all for 2 s on ")
    with can.Bus(**VCAN0) as other:
        other.send(can.Message(arbitration_id=0x321, data=bytes(8), is_extended_id=False))
        daemon.read_until("first frame on ")
        daemon.read_until("none of the 1 frames has a mapped identifier: most seen are 321 (1)")
    summary = daemon.stop()
    assert len(summary["missing"]) == 1
