"""Two processes on a real SocketCAN bus: one injects, one estimates; and what they survive.

Needs vcan0 and vcan1: ``tools/with-vcan pytest -m socketcan`` where the kernel has none.
"""

import json
import os
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import can
import cantools
import numpy as np
import pytest

from dctorque_can.daemon.wire.kernel_filter import OPEN_S, Wanted
from dctorque_can.daemon.wire.link import BusLink, open_bus
from dctorque_can.daemon.wire.reception import receiver_of
from dctorque_can.daemon.wire.socketcan import SocketcanReceiver
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES
from dctorque_can.logs.messages import frames_from_messages
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import EXTENDED_ID, Address, FrameFlag, Frames, group_mask
from dctorque_can.resources import shipped_config, shipped_dbc

pytestmark = pytest.mark.socketcan

PAPER = shipped_config("paper_car")
CAR = [str(PAPER), "-i", "socketcan", "--channel", "vcan0"]
SECONDS = 6
HANG_S = 900  # so late that no load of the machine explains it
FRAMES = 400 * SECONDS


class Daemon:
    """``dctorque run``, on vcan0 unless told otherwise."""

    def __init__(
        self,
        command: list[str],
        environment: dict[str, str],
        folder: Path,
        log: str,
        car: list[str] = CAR,
        buses: str = "vcan0",
    ) -> None:
        arguments = ["run", *car, "--log", log, "--json"]
        self.log = folder / log
        self.err: list[str] = []
        self.process = subprocess.Popen(
            [*command, *arguments],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.read_until(f"estimating on socketcan:{buses};")

    def read_until(self, text: str) -> None:
        assert self.process.stderr is not None
        while not self.err or text not in self.err[-1]:
            line = self.process.stderr.readline()
            assert line, self.err
            self.err.append(line)

    def stop(self) -> dict:
        self.process.send_signal(signal.SIGINT)
        out, err = self.process.communicate(timeout=HANG_S)
        assert self.process.returncode == 0, err
        assert "Traceback" not in err
        return json.loads(out)

    def received(self) -> int:
        """Return how many received frames are in the log by now."""
        return len(frames_in(self.log, sent=False))

    def kill_group(self) -> None:
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(HANG_S)
        for pipe in (self.process.stdout, self.process.stderr):
            assert pipe is not None
            pipe.close()


@pytest.fixture
def start(command: list[str], environment: dict[str, str], tmp_path: Path) -> Iterator:
    started: list[Daemon] = []

    def start(log: str) -> Daemon:
        started.append(Daemon(command, environment, tmp_path, log))
        return started[-1]

    yield start
    for daemon in started:
        if daemon.process.poll() is None:
            daemon.kill_group()


@pytest.fixture
def inject(command: list[str], environment: dict[str, str], tmp_path: Path):
    """Start the injector: a process that drives the simulated car for some seconds on vcan0."""

    def inject(seconds: int) -> subprocess.Popen[str]:
        arguments = ["simulate", "-i", "socketcan", "--channel", "vcan0", "--duration", str(seconds)]
        return subprocess.Popen(
            [*command, *arguments], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True
        )

    return inject


def sent_by(process: subprocess.Popen[str]) -> str:
    _, err = process.communicate(timeout=HANG_S)
    assert process.returncode in (0, 3), err
    assert "Traceback" not in err
    return err


@contextmanager
def listening_to(can_id: int) -> Iterator[list[can.Message]]:
    """Give a list that fills with the messages of one identifier."""
    heard: list[can.Message] = []
    end = threading.Event()
    filters = [{"can_id": can_id, "can_mask": 0x7FF}]
    with open_bus({"interface": "socketcan", "channel": "vcan0", "can_filters": filters}) as ear:

        def listen() -> None:
            while not end.is_set():
                if (message := ear.recv(0.1)) is not None:
                    heard.append(message)

        thread = threading.Thread(target=listen)
        thread.start()
        try:
            yield heard
        finally:
            end.set()
            thread.join()


def set_link(state: str) -> None:
    subprocess.run(["ip", "link", "set", "vcan0", state], check=True)


def wait_until(condition: Callable[[], bool]) -> None:
    limit = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.1)


def frames_in(log: Path, sent: bool) -> Frames:
    """Return the frames that the daemon has sent, or received."""
    with open_log(log) as reader:
        frames = Frames.concatenate(reader.frames())
    return frames[((frames.flags & FrameFlag.SENT) != 0) == sent]


def test_one_process_injects_and_one_estimates(start, inject, dctorque, tmp_path: Path) -> None:
    """Every frame arrives, estimates are heard on the bus, and a replay of the log gives the same bits."""
    daemon = start("live.mcap")
    output = cantools.database.load_file(shipped_dbc("dctorque"))
    torque = output.get_message_by_name("DctClutchTorque")
    with listening_to(torque.frame_id) as heard:
        err = sent_by(inject(SECONDS))
        wait_until(lambda: daemon.received() == FRAMES)
        summary = daemon.stop()
        spoken = frames_in(daemon.log, sent=True)
        spoken = spoken[spoken.can_id == torque.frame_id]
        wait_until(lambda: len(heard) == len(spoken))
    assert f"{FRAMES} frames sent, 0 not taken" in err
    assert summary["frames"] == FRAMES
    assert summary["log"]["dropped"] == 0
    assert summary["estimates"] > 0
    assert len(heard) > 0
    assert [bytes(message.data) for message in heard] == [bytes(data[: torque.length]) for data in spoken.data]

    assert dctorque("replay", daemon.log, "-o", tmp_path / "again.mcap").code == 0
    live, again = (read_table(path, ESTIMATES) for path in (daemon.log, tmp_path / "again.mcap"))
    assert len(live) == summary["estimates"]
    assert live.tobytes() == again.tobytes()


MIXED = [
    can.Message(arbitration_id=0x123, data=b"\1\2\3", is_extended_id=False),
    can.Message(arbitration_id=0x7FF, is_extended_id=False),
    can.Message(arbitration_id=0x18FEF100, data=bytes(range(8))),
    can.Message(arbitration_id=0x124, is_extended_id=False, is_remote_frame=True, dlc=4),
    can.Message(arbitration_id=0x55, data=bytes(range(7)), is_fd=True, is_extended_id=False),
    can.Message(arbitration_id=0x18FEF101, data=bytes(range(64)), is_fd=True, bitrate_switch=True),
    can.Message(arbitration_id=0x56, data=bytes(20), is_fd=True, bitrate_switch=True, error_state_indicator=True),
    can.Message(arbitration_id=0x004, data=bytes(8), is_error_frame=True, is_extended_id=False),
]


def test_a_batch_of_the_kernel_is_what_python_can_receives_frame_by_frame() -> None:
    """All kinds of frames, those of another program and those of the same socket that come back."""
    arguments = {"interface": "socketcan", "channel": "vcan0", "fd": True, "receive_own_messages": True}
    with open_bus(arguments) as sender, open_bus(arguments) as ours, open_bus(arguments) as theirs:
        receiver = receiver_of(ours)
        assert isinstance(receiver, SocketcanReceiver)
        for message in MIXED:
            sender.send(message)
            ours.send(message)
        expected = [theirs.recv(HANG_S) for _ in range(2 * len(MIXED))]
        parts: list[Frames] = []
        while sum(map(len, parts)) < len(expected):
            part = receiver.receive(1.0)
            parts.append(Frames.concatenate([part]))  # a copy: the next call writes over it
    stock = frames_from_messages([message for message in expected if message is not None])
    batch = Frames.concatenate(parts)
    for name in ("can_id", "length", "flags", "channel", "data"):
        np.testing.assert_array_equal(getattr(batch, name), getattr(stock, name), err_msg=name)
    assert np.abs(batch.t_us - stock.t_us).max() <= 1  # python-can's are floats, rounded


def test_frames_that_do_not_fit_into_the_buffer_are_counted() -> None:
    with open_bus({"interface": "socketcan", "channel": "vcan0"}) as bus, can.Bus("vcan0", "socketcan") as car:
        receiver = receiver_of(bus)
        bus.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)  # the kernel makes the smallest of it
        for _ in range(200):
            car.send(can.Message(arbitration_id=0x100, data=bytes(8), is_extended_id=False))
        received = 0
        while n := len(receiver.receive(0.1)):
            received += n
        car.send(can.Message(arbitration_id=0x100, data=bytes(8), is_extended_id=False))  # the next one says it
        assert len(receiver.receive(HANG_S)) == 1
    assert receiver.dropped == 200 - received > 0


def test_the_kernel_leaves_out_what_is_not_wanted_while_mapped_frames_come() -> None:
    """Of 29 bits by parameter group, from every source; error frames always; and all, once nothing passes."""
    group, ours, other = 0x18FEF100, 0x6F0, 0x400
    wanted = Wanted([Address(0x100), Address(group | EXTENDED_ID, group_mask(group | EXTENDED_ID))], {ours})
    told: list[str] = []
    connect = partial(open_bus, {"interface": "socketcan", "channel": "vcan0", "receive_own_messages": False})
    link = BusLink(connect, lambda is_error, text: told.append(text), wanted=wanted)
    link.open()

    def heard(car: can.BusABC, *messages: can.Message) -> list[int]:
        """Return what is received of some frames and of a mapped one behind them, but for that."""
        for message in (*messages, can.Message(arbitration_id=group | 0x17)):
            car.send(message)
        found: list[int] = []
        while not found or found[-1] != group | 0x17 | EXTENDED_ID:
            found += link.receive(1.0).can_id.tolist()
        return found[:-1]

    def standard(can_id: int, **more: bool) -> can.Message:
        return can.Message(arbitration_id=can_id, data=bytes(8), is_extended_id=False, **more)

    with can.Bus("vcan0", "socketcan") as car:
        assert heard(car, standard(other)) == [other]  # nothing mapped has come before
        frames = [standard(other), can.Message(arbitration_id=0x100), standard(ours), standard(0x100)]
        assert heard(car, *frames, standard(4, is_error_frame=True)) == [ours, 0x100, 4]
        assert link.filtered
        until_s = time.monotonic() + 1.5 * OPEN_S
        while time.monotonic() < until_s:
            assert len(link.receive(0.1)) == 0
        car.send(standard(other))
        while not len(frames_now := link.receive(1.0)):
            pass
        assert frames_now.can_id.tolist() == [other]
    assert link.counts.silences == 0
    assert len(told) == 1
    assert "error frames" in told[0]
    link.close()


def test_the_daemon_survives_a_bus_that_goes_down_and_comes_back(start, inject) -> None:
    daemon = start("live.mcap")
    injector = inject(60)
    wait_until(lambda: daemon.received() > 0)
    try:
        set_link("down")
        daemon.read_until("the bus is gone")
        time.sleep(1)
    finally:
        set_link("up")
    daemon.read_until("the bus is open again")
    before = daemon.received()
    wait_until(lambda: daemon.received() > before + 400)
    injector.send_signal(signal.SIGINT)
    injector.communicate(timeout=HANG_S)
    summary = daemon.stop()
    assert summary["link"]["lost"] >= 1
    assert summary["link"]["reconnects"] >= 1
    assert summary["health"]["gap_resets"] >= 1
    estimates = read_table(daemon.log, ESTIMATES)
    assert len(estimates) == summary["estimates"]
    silence = np.diff(estimates["t_us"])
    assert silence.max() > 900_000
    assert silence.argmax() < len(silence) - 50  # it estimates again


def test_a_killed_daemon_leaves_a_readable_log(start, inject) -> None:
    """What the flush timer has put into the log stays there, although the log writer is killed too."""
    daemon = start("live.mcap")
    sent_by(inject(SECONDS))
    wait_until(lambda: daemon.received() == FRAMES)
    daemon.kill_group()
    assert daemon.received() == FRAMES


def test_a_bus_that_is_down_at_the_start_is_one_clear_error(dctorque) -> None:
    set_link("down")
    try:
        outcome = dctorque("run", PAPER, "-i", "socketcan", "--channel", "vcan0", "--no-log")
    finally:
        set_link("up")
    assert outcome.code == 1
    assert "vcan0 cannot be used: Network is down" in " ".join(outcome.err.split())
    assert "ip link set vcan0 up" in " ".join(outcome.err.split())


def test_nothing_is_sent_on_an_identifier_of_someone_else(start, inject) -> None:
    taken = 0x6F0
    daemon = start("live.mcap")
    with can.Bus(interface="socketcan", channel="vcan0") as other:
        other.send(can.Message(arbitration_id=taken, data=bytes(8), is_extended_id=False))
        daemon.read_until("someone else sends on 0x6F0")
        sent_by(inject(2))
        heard = set()
        while (message := other.recv(0.2)) is not None:
            heard.add(message.arbitration_id)
    summary = daemon.stop()
    assert summary["refused_ids"] == [taken]
    assert taken not in heard
    assert summary["published"] > 0


def test_two_buses_are_one_service(command: list[str], environment: dict[str, str], tmp_path: Path) -> None:
    """The car is on channel 5 alone; the other bus has its identifiers too, goes away, and gets the estimates."""
    text = PAPER.read_text().replace("../dbc/demo_car.dbc", str(shipped_dbc("demo_car")))
    lines = [line for line in text.splitlines() if not line.startswith(("can:", "output:"))]
    lines += [
        "can:",
        "  - {interface: socketcan, channel: vcan0}",
        "  - {interface: socketcan, channel: vcan1, number: 5}",
        "output: {enabled: true, channel: 0}",
    ]
    (tmp_path / "two.yaml").write_text("\n".join(lines).replace("strict: true}", "channel: 5}"))
    daemon = Daemon(command, environment, tmp_path, "two.mcap", ["two.yaml"], "vcan0 and socketcan:vcan1")
    car = [*command, "simulate", "-i", "socketcan", "--duration", str(SECONDS), "--channel"]
    both = [
        subprocess.Popen([*car, name], cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True)
        for name in ("vcan0", "vcan1")
    ]
    while daemon.received() < FRAMES:
        time.sleep(0.1)
    set_link("down")
    daemon.read_until("socketcan:vcan0: the bus is gone")
    set_link("up")
    daemon.read_until("socketcan:vcan0: the bus is open again")
    for process in both:
        sent_by(process)
    summary = daemon.stop()
    first, second = summary["buses"]
    assert (first["name"], first["number"], second["name"], second["number"]) == (
        *("socketcan:vcan0", 0),
        *("socketcan:vcan1", 5),
    )
    assert first["lost"] >= 1
    assert (second["lost"], second["received"]) == (0, FRAMES)
    assert summary["never_received"] == []
    assert summary["health"]["late_frames"] == 0
    assert summary["valid_estimates"] > 0
    frames = frames_in(daemon.log, sent=False)
    assert (np.diff(frames.t_us) >= 0).all()
    assert np.count_nonzero(frames.channel == 5) == FRAMES
    sent = frames_in(daemon.log, sent=True)
    assert len(sent) == summary["published"] > 0
    assert not sent.channel.any()
    done = subprocess.run(
        [*command, "replay", "two.mcap", "-o", "again.mcap"], cwd=tmp_path, env=environment, check=False
    )
    assert done.returncode == 0
    live, again = (read_table(tmp_path / name, ESTIMATES) for name in ("two.mcap", "again.mcap"))
    assert live.tobytes() == again.tobytes()
