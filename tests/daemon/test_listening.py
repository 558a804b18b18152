"""A bus that is only listened to: nothing of ours on the wire, by whatever way."""

import os
import pty
import threading
import time
import tty
from functools import partial
from pathlib import Path

import can
import pytest
from can.interfaces.virtual import VirtualBus

from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.service import Service
from dctorque_can.daemon.wire.link import BusLink, open_bus
from dctorque_can.daemon.wire.listening import HARDWARE, ListenOnlyError, listening, remark
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.offline.playback import playing
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.resources import shipped_config

MESSAGE = can.Message(arbitration_id=0x100, data=b"\1", is_extended_id=False)


def test_a_bus_of_python_can_refuses_every_way_of_sending(config: Config) -> None:
    arguments = config.can.arguments()
    with open_bus(arguments, listen_only=True) as bus, open_bus(arguments) as ear:
        with pytest.raises(ListenOnlyError):
            bus.send(MESSAGE)
        with pytest.raises(ListenOnlyError):
            bus.send(MESSAGE, 1.0)
        with pytest.raises(ListenOnlyError):
            bus.send_periodic(MESSAGE, 0.01)
        ear.send(MESSAGE)
        assert bus.recv(1.0) is not None
        assert ear.recv(0.05) is None


def test_a_link_has_nothing_to_send_with(config: Config) -> None:
    """Also where the bus itself would send."""
    with open_bus(config.can.arguments()) as ear:
        link = BusLink(partial(open_bus, config.can.arguments()), lambda is_error, text: None, listen_only=True)
        link.open()
        assert not link.send(MESSAGE)
        assert (link.counts.send_failures, link.counts.sent, link.up) == (1, 0, True)
        assert ear.recv(0.05) is None
        link.close()


@pytest.mark.parametrize("settings", [{"can.listen_only": "true", "output.enabled": "false"}, None])
def test_a_service_that_listens_only_is_not_heard(
    config: Config, drive: SimulatedDrive, settings: dict[str, str] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the vehicle file, and by the command line against a file that enables the output."""
    if settings is None:
        quiet = config.listening_only()
    else:
        channel = {"can.interface": "virtual", "can.channel": str(config.can.channel)}
        quiet = load_config(shipped_config("paper_car"), channel | settings)
    sent: list[can.Message] = []
    send = VirtualBus.send

    def spied(self: VirtualBus, msg: can.Message, timeout: float | None = None) -> None:
        sent.append(msg)
        send(self, msg, timeout)

    monkeypatch.setattr(VirtualBus, "send", spied)
    (bus,) = quiet.buses
    service = Service(quiet, [partial(open_bus, bus.arguments(), bus.listen_only)], None, lambda *told: None)
    service.prepare()
    summaries = []
    thread = threading.Thread(target=lambda: summaries.append(service.run()), daemon=True)
    thread.start()
    frames = drive.frames[:1000]
    with open_bus(config.can.arguments()) as car:
        for i in range(len(frames)):
            car.send(message_from_frame(frames, i))
        while service.received < len(frames):
            time.sleep(0.002)
        service.stop()
        thread.join()
        assert car.recv(0.05) is None
    (summary,) = summaries
    assert summary.estimates > 500
    assert (summary.published, summary.output) == (0, None)
    assert len(sent) == len(frames)  # the car's own
    assert summary.buses[0]["listen_only"]


def test_an_adapter_is_opened_in_its_own_listen_only_mode_and_given_no_frame() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    arguments = {"interface": "slcan", "channel": os.ttyname(slave), "sleep_after_open": 0.0, "bitrate": 500_000}
    try:
        with open_bus(arguments, listen_only=True) as bus, pytest.raises(ListenOnlyError):
            bus.send(MESSAGE)
        written = os.read(master, 1 << 12)
    finally:
        os.close(master)
        os.close(slave)
    lines = written.split(b"\r")
    assert b"L" in lines
    assert set(lines) <= {b"C", b"S6", b"L", b""}


def test_what_python_can_calls_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every argument is one that the interface has, and none silences another interface."""
    from inspect import signature

    from can.interfaces.kvaser import KvaserBus
    from can.interfaces.pcan import PcanBus
    from can.interfaces.seeedstudio import SeeedBus
    from can.interfaces.slcan import slcanBus
    from can.interfaces.vector import VectorBus

    known = {"kvaser": KvaserBus, "pcan": PcanBus, "seeedstudio": SeeedBus, "slcan": slcanBus, "vector": VectorBus}
    for interface, bus in known.items():
        options = signature(bus.__init__).parameters
        if interface == "kvaser":
            assert {"driver_mode", "single_handle"} <= set(HARDWARE[interface])
            continue  # it takes them as further arguments
        assert set(HARDWARE[interface]) <= set(options)
    assert listening({"interface": "slcan", "channel": "x", "listen_only": False})["listen_only"] is False
    assert listening({"interface": "socketcan", "channel": "can0"}) == {
        "interface": "socketcan",
        "channel": "can0",
    }


def test_hardware_that_still_acknowledges_is_told() -> None:
    assert "type can listen-only on" in (remark("socketcan", "can3") or "")
    assert "no listen-only mode" in (remark("gs_usb", "0") or "")
    assert (remark("slcan", "/dev/ttyACM0"), remark("virtual", "x")) == (None, None)


def test_nothing_can_be_played_onto_it(config: Config) -> None:
    bus = config.listening_only().can
    with pytest.raises(DctorqueError, match="listen_only: true"), playing(bus, lambda is_error, text: None):
        pytest.fail("it was opened")


def test_an_output_on_it_is_an_error_of_the_vehicle_file(tmp_path: Path) -> None:
    wrong = {"can.listen_only": "true", "output.enabled": "true"}
    with pytest.raises(DctorqueError, match=r"output\.enabled.*is listen_only: send on another bus"):
        load_config(shipped_config("paper_car"), wrong)
