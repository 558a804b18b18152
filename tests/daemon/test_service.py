"""The service on a virtual bus: nothing lost, nothing different from a replay."""

import resource
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from mcap.reader import make_reader

from dctorque_can.config.load import Config
from dctorque_can.daemon.log.plan import plan_for
from dctorque_can.daemon.service import Service, Summary
from dctorque_can.daemon.wire import link
from dctorque_can.daemon.wire.link import BusError, BusLink
from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.playback import Player
from dctorque_can.offline.replay import ReplayContent, ReplayTargets, replay_logs
from dctorque_can.offline.simulated_car import DriveName, ProfileName, SimulatedDrive, simulate_car
from dctorque_can.pipeline.frames import FrameFlag, Frames

from ..clock import Clock

Connect = Callable[[], can.BusABC]


@dataclass
class Live:
    """A service in a thread."""

    service: Service
    thread: threading.Thread
    told: list[str]
    summaries: list[Summary]

    def wait_for(self, frames: int) -> None:
        while self.service.received < frames:
            assert self.thread.is_alive(), self.told
            time.sleep(0.002)

    def stop(self) -> Summary:
        self.service.stop()
        self.thread.join()
        (summary,) = self.summaries
        return summary


def start(config: Config, connect: Connect, log: Path | None, **more: Any) -> Live:
    told: list[str] = []
    plan = None if log is None else plan_for(config, log)
    service = Service(config, [connect], plan, lambda is_error, text: told.append(text), **more)
    service.prepare()
    summaries: list[Summary] = []
    thread = threading.Thread(target=lambda: summaries.append(service.run()), daemon=True)
    thread.start()
    return Live(service, thread, told, summaries)


def send(connect: Connect, frames: Frames) -> None:
    with connect() as bus:
        for i in range(len(frames)):
            bus.send(message_from_frame(frames, i))


def replayed(path: Path, config: Config, output: Path) -> Path:
    with open_log(path) as log:
        replay_logs([log], config, ReplayTargets(output), ReplayContent(), lambda fraction: None)
    return output


@pytest.fixture
def live_log(config: Config, connect: Connect, drive: SimulatedDrive, folder: Path) -> Path:
    live = start(config, connect, folder / "live.mcap")
    send(connect, drive.frames)
    live.wait_for(len(drive.frames))
    summary = live.stop()
    assert summary.complete
    assert summary.frames == len(drive.frames)
    assert summary.log is not None
    assert summary.log.written == summary.frames + summary.published
    assert summary.published > 500
    return folder / "live.mcap"


def test_a_replay_of_a_live_log_gives_the_same_bits(live_log: Path, config: Config, tmp_path: Path) -> None:
    again = replayed(live_log, config, tmp_path / "again.mcap")
    live, offline = read_table(live_log, ESTIMATES), read_table(again, ESTIMATES)
    assert len(live) > 2000
    assert live.tobytes() == offline.tobytes()
    assert read_table(live_log, HEALTH).tobytes() == read_table(again, HEALTH).tobytes()


def test_a_replay_of_the_same_frames_in_asc_gives_the_same_bits(
    live_log: Path, config: Config, tmp_path: Path
) -> None:
    """ASC keeps differences of time only, so the times differ by one constant, whatever it is."""
    with open_log(live_log) as log:
        received = Frames.concatenate(frames[(frames.flags & FrameFlag.SENT) == 0] for frames in log.frames())
    write_frames(tmp_path / "live.asc", received)
    again = replayed(tmp_path / "live.asc", config, tmp_path / "again.mcap")
    live, offline = read_table(live_log, ESTIMATES), read_table(again, ESTIMATES)
    assert len(live) == len(offline)
    assert len(np.unique(live["t_us"] - offline["t_us"])) == 1
    names = [name for name in ESTIMATES.dtype.names or () if name != "t_us"]
    for name in names:
        np.testing.assert_array_equal(live[name], offline[name], err_msg=name)


def test_live_frames_are_logged_as_they_were_sent(live_log: Path, drive: SimulatedDrive) -> None:
    with open_log(live_log) as log:
        frames = Frames.concatenate(log.frames())
    sent = (frames.flags & FrameFlag.SENT) != 0
    received = frames[~sent]
    for name in ("t_us", "can_id", "length", "data"):
        np.testing.assert_array_equal(getattr(received, name), getattr(drive.frames, name))
    assert sent.any()


def test_no_frame_is_lost_at_4000_frames_per_second(config: Config, connect: Connect, folder: Path) -> None:
    laboratory = simulate_car(config, DriveName.PAPER, ProfileName.LABORATORY, seed=1, duration_s=2.0)
    live = start(config, connect, folder / "live.mcap")
    sender = BusLink(connect, lambda is_error, text: None)
    sender.open()
    player = Player(sender, speed=0.8)  # of 5000 frames/s
    player.play(laboratory.frames)
    live.wait_for(len(laboratory.frames))
    summary = live.stop()
    sender.close()
    assert summary.frames == len(laboratory.frames) == player.sent
    assert summary.complete


STEPS = {
    "back": {1.2: -3600.0},
    "back, while it listens": {0.2: -3600.0},
    "forwards": {1.2: 3600.0},
    "forwards, while it listens": {0.2: 1e9},
    "back, a little": {1.2: -0.08},
    "back, a little more": {1.2: -0.15},
    "forwards, a little": {1.2: 0.3},
    "there and back": {1.2: 5.0, 1.21: -5.0, 1.6: -1e9, 1.9: 1e9},
    "back, again and again": dict.fromkeys(np.arange(1.0, 2.4, 0.15).round(3).tolist(), -0.15),
}


@pytest.mark.parametrize("name", STEPS)
def test_estimates_are_sent_within_half_a_second_of_any_step_of_the_clock(
    config: Config, connect: Connect, drive: SimulatedDrive, name: str
) -> None:
    """As after an NTP step: the stamps of the frames follow the system clock."""
    bus_s = (drive.frames.t_us - drive.frames.t_us[0]) / 1e6
    frames = drive.frames[bus_s < 2.5]
    step_us = sum(np.where(bus_s >= at_s, round(step_s * 1e6), 0) for at_s, step_s in STEPS[name].items())
    frames = replace(frames, t_us=frames.t_us + step_us[: len(frames)])
    live = start(config, connect, None)
    sent_s: dict[int, list[float]] = {message.frame_id: [0.5] for message in config.output.database.messages}
    with connect() as car, connect() as ear:
        for i in range(len(frames)):
            car.send(message_from_frame(frames, i))
            live.wait_for(i + 1)
            while (message := ear.recv(0.0)) is not None:
                if message.arbitration_id in sent_s:
                    sent_s[message.arbitration_id].append(bus_s[i])
    summary = live.stop()
    for can_id, times_s in sent_s.items():
        assert np.diff([*times_s, 2.5]).max() < 0.5, f"{can_id:x}"
        assert len(times_s) > 15
    told = [line.split(" by ")[0] for line in live.told if "the clock of the frames was set" in line]
    ways = ["back" if step_s < 0 else "forwards" for step_s in STEPS[name].values()]
    if "a little" not in name or name == "back, a little more":  # the others are less than a busy machine is late
        assert told == [f"the clock of the frames was set {way}" for way in ways]
        assert summary.clock_steps == len(ways)
    assert summary.health["clock_resets"] == sum(step_s < -0.1 for step_s in STEPS[name].values())
    assert (summary.health["late_frames"] > 0) == (name == "back, a little")


def test_a_second_service_on_the_bus_stays_silent(config: Config, connect: Connect, drive: SimulatedDrive) -> None:
    first = start(config, connect, None)
    half = len(drive.frames) // 2
    send(connect, drive.frames[:half])
    first.wait_for(half)
    second = start(config, connect, None)
    with connect() as bus:
        for i in range(half, len(drive.frames)):
            bus.send(message_from_frame(drive.frames, i))
            first.wait_for(i + 1)  # so that its frames reach the bus in their turn
    second.wait_for(len(drive.frames) - half)
    spoke, silent = first.stop(), second.stop()
    assert spoke.published > 0
    assert spoke.refused_ids == []
    assert silent.published == 0
    assert len(silent.refused_ids) == len(config.output.database.messages)


def test_frames_of_other_programs_on_this_computer_are_inputs(
    config: Config, connect: Connect, drive: SimulatedDrive
) -> None:
    """SocketCAN calls them transmitted, as it calls our own when they come back."""
    live = start(config, connect, None)
    for i in range(400):
        message = message_from_frame(drive.frames, i)
        message.is_rx = False
        live.service._links.links[0]._bus.queue.put(message)  # type: ignore[union-attr]
    live.wait_for(400)
    assert live.stop().estimates > 300


def test_the_loss_of_the_bus_resets_and_is_noted_in_the_log(
    config: Config, connect: Connect, drive: SimulatedDrive, folder: Path
) -> None:
    """One second of frames, a bus that fails, and frames from three seconds later."""
    gone = threading.Event()

    def flaky() -> can.BusABC:
        if gone.is_set():
            raise BusError("virtual: away")
        return connect()

    live = start(config, flaky, folder / "live.mcap")
    t_us = drive.frames.t_us - drive.frames.t_us[0]
    before, after = drive.frames[t_us < 1_000_000], drive.frames[t_us > 4_000_000]
    send(connect, before)
    live.wait_for(len(before))
    gone.set()
    live.service._links.links[0]._bus.shutdown()  # type: ignore[union-attr]
    while not live.service._links.away:
        time.sleep(0.01)
    gone.clear()
    while live.service._links.away:
        time.sleep(0.01)
    send(connect, after)
    live.wait_for(len(before) + len(after))
    summary = live.stop()
    assert (summary.link.lost, summary.link.reconnects) == (1, 1)
    assert summary.health["gap_resets"] == 1
    assert any("gone" in line for line in live.told)
    content = (folder / "live.mcap").read_bytes()
    assert b"/dctorque/events" in content
    assert len(read_table(folder / "live.mcap", ESTIMATES)) == summary.estimates


def test_a_silent_bus_is_told_and_noted_in_the_log_and_stays_open(
    config: Config,
    connect: Connect,
    drive: SimulatedDrive,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    clock: Clock,
) -> None:
    monkeypatch.setattr(link, "time", clock)
    live = start(config, connect, folder / "live.mcap")
    send(connect, drive.frames[:100])
    live.wait_for(100)
    clock.now_s += 2.5
    while not any("no frame for 2 s" in line for line in live.told):
        time.sleep(0.01)
    send(connect, drive.frames[100:200])
    live.wait_for(200)
    summary = live.stop()
    assert any("frames again after 2.5 s" in line for line in live.told)
    assert (summary.link.silences, summary.link.lost) == (1, 0)
    with (folder / "live.mcap").open("rb") as stream:
        texts = [message.data for _, _, message in make_reader(stream).iter_messages(["/dctorque/events"])]
    assert sum(b"no frame for" in text for text in texts) == 1
    assert sum(b"frames again" in text for text in texts) == 1


def test_a_bus_that_is_not_there_yet_is_waited_for_when_asked(
    config: Config, connect: Connect, drive: SimulatedDrive
) -> None:
    tries = iter([BusError("virtual: not there"), BusError("virtual: not there")])

    def late() -> can.BusABC:
        if (error := next(tries, None)) is not None:
            raise error
        return connect()

    told: list[str] = []
    service = Service(config, [late], None, lambda is_error, text: told.append(text))
    service.prepare(wait_for_bus=True)
    thread = threading.Thread(target=service.run, daemon=True)
    thread.start()
    while service._links.away:
        time.sleep(0.01)
    live = Live(service, thread, told, [])
    send(connect, drive.frames[:100])
    live.wait_for(100)
    service.stop()
    thread.join()
    assert "waiting for it" in told[0]
    assert "open again" in told[1]


def test_a_disk_that_fills_up_stops_the_log_and_nothing_else(
    config: Config, connect: Connect, drive: SimulatedDrive, folder: Path
) -> None:
    """The file size limit of the writer stands for the end of the disk."""
    live = start(config, connect, folder / "live.mcap")
    log = live.service._log
    assert log is not None
    assert log._process is not None
    resource.prlimit(log._process.pid, resource.RLIMIT_FSIZE, (60_000, 60_000))
    send(connect, drive.frames)
    live.wait_for(len(drive.frames))
    summary = live.stop()
    assert summary.frames == len(drive.frames)
    assert summary.estimates > 2000
    assert not summary.complete
    assert summary.log is not None
    assert summary.log.dropped > 0
    assert any("File too large" in line for line in live.told)


@pytest.mark.parametrize("fill", [0x00, 0xFF])
def test_frames_of_all_zeros_and_all_ones_are_counted_and_change_nothing(
    config: Config, connect: Connect, drive: SimulatedDrive, fill: int
) -> None:
    live = start(config, connect, None)
    frames = replace(drive.frames[:400], data=np.full((400, 8), fill, np.uint8))
    send(connect, frames)
    live.wait_for(len(frames))
    summary = live.stop()
    assert summary.health["bad_crc"]
    assert sum(summary.health["bad_crc"].values()) > 0
    assert summary.frames == 400
