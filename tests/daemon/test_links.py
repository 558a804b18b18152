"""Several buses as one: order, channels, a bus that is away, and a service on two of them."""

import os
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest

from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon import service as service_module
from dctorque_can.daemon.log.plan import plan_for
from dctorque_can.daemon.service import Service, Summary
from dctorque_can.daemon.wire import links as links_module
from dctorque_can.daemon.wire.link import BusError, open_bus
from dctorque_can.daemon.wire.links import CLOCKS_APART_S, MOST_HELD, BusLinks, NamedBus
from dctorque_can.daemon.wire.socketcan import MOST
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.replay import ReplayContent, ReplayResult, ReplayTargets, replay_logs
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames
from dctorque_can.report.traffic_lines import missing_lines
from dctorque_can.resources import shipped_config, shipped_dbc

from ..clock import Clock
from .test_link import SocketCand

BRAKES = (0x130, 0x131)  # what the second bus of the car carries


class Wire:
    """Frames that come at their times while the clock runs; to look takes a while."""

    up, file_number = True, -1

    def __init__(self, t_us: list[int], clock: Clock, look_s: float, late_s: float = 0.0) -> None:
        self._t_us = sorted(t_us)
        self._clock = clock
        self._look_s = look_s
        self._late_s = late_s
        self.taken = 0

    def look(self, timeout_s: float) -> Frames:
        self._clock.now_s += self._look_s
        now_us = round(1e6 * (self._clock.now_s - self._late_s))
        there = int(np.searchsorted(self._t_us, now_us, side="right"))
        n = min(there - self.taken, MOST)
        frames = Frames.empty(n)
        frames.t_us[:] = self._t_us[self.taken : self.taken + n]
        self.taken += n
        return frames


def on(clock: Clock, monkeypatch: pytest.MonkeyPatch, *wires: Any) -> tuple[BusLinks, list[str]]:
    told: list[str] = []
    monkeypatch.setattr(links_module, "time", clock)
    buses = [NamedBus(f"bus {n}", 3 * n + 1, can.Bus) for n in range(len(wires))]
    links = BusLinks(buses, lambda is_error, text: told.append(text))
    links.links = list(wires)
    return links, told


def received(links: BusLinks, wires: tuple[Wire, ...]) -> Frames:
    parts = []
    while any(wire.taken < len(wire._t_us) for wire in wires):
        parts.append(links.receive(0.1).copy())
        assert len(links._held) < MOST_HELD + len(wires) * MOST
    parts += [links.receive(0.0).copy() for _ in range(2)]
    return Frames.concatenate(parts)


@pytest.mark.parametrize("seed", range(30))
def test_frames_of_several_buses_are_in_order_of_time(
    seed: int, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Random traffic, with a burst of more than one look takes, and looks that last up to a millisecond."""
    random = np.random.default_rng(seed)
    begin, look_s = round(1e6 * clock.now_s), random.uniform(1e-5, 1e-3)
    wires = tuple(
        Wire((begin + random.integers(0, 500_000, n)).tolist() + [begin + 7_000] * burst, clock, look_s)
        for n, burst in ((2000, 0), (300, 2 * MOST), (int(random.integers(1, 4000)), 0))
    )
    links, told = on(clock, monkeypatch, *wires)
    frames = received(links, wires)
    assert (np.diff(frames.t_us) >= 0).all()
    for n, wire in enumerate(wires):
        assert frames.t_us[frames.channel == 3 * n + 1].tolist() == wire._t_us
    assert told == []


def test_nothing_waits_for_longer_than_to_the_next_look(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    begin, look_s = round(1e6 * clock.now_s), 1e-4
    wires = tuple(Wire(list(range(begin + n, begin + 300_000, 700)), clock, look_s) for n in (1, 2))
    links, _ = on(clock, monkeypatch, *wires)
    ages = []
    while wires[0].taken < len(wires[0]._t_us):
        frames = links.receive(0.1)
        ages += (1e6 * clock.now_s - frames.t_us).tolist()
    rest_us, looks_us = 1e3, 6 * 1e6 * look_s  # two receives, each of two looks and one again
    assert min(ages) >= 0
    assert max(ages) < rest_us + looks_us + 100


def test_an_interface_that_is_late_gives_late_frames_and_holds_nobody_up(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = round(1e6 * clock.now_s)
    wires = tuple(
        Wire(list(range(begin + n, begin + 200_000, 900)), clock, 1e-4, late_s)
        for n, late_s in ((1, 0.0), (2, 0.02))
    )
    frames = received(on(clock, monkeypatch, *wires)[0], wires)
    behind = np.maximum.accumulate(frames.t_us) - frames.t_us
    assert 18_000 < behind.max() < 22_000
    assert not behind[frames.channel == 1].any()
    assert len(frames) == sum(len(wire._t_us) for wire in wires)


def test_clocks_that_differ_are_told_once(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    begin = round(1e6 * clock.now_s)
    length_us = round(2e6 * CLOCKS_APART_S)
    near = Wire(list(range(begin, begin + length_us, 5_000)), clock, 1e-4)
    far = Wire(list(range(begin, begin + length_us, 5_000)), clock, 1e-4)
    late = far.look

    def look(timeout_s: float) -> Frames:
        frames = late(timeout_s)
        frames.t_us[:] -= 12_300_000
        return frames

    monkeypatch.setattr(far, "look", look)
    links, told = on(clock, monkeypatch, near, far)
    received(links, (near, far))
    (line,) = told
    assert line.startswith("the times of bus 1 are 12.3 s behind those of bus 0: ")


def test_one_file_of_several_wakes_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bus that can be waited for is waited for, and looked at with some patience once it is ready."""
    reading, writing = os.pipe()
    waits: list[float] = []

    def look(timeout_s: float) -> Frames:
        waits.append(timeout_s)
        return Frames.empty(1 if timeout_s else 0)

    silent = SimpleNamespace(up=True, file_number=os.open(os.devnull, os.O_RDONLY), look=lambda _: Frames.empty())
    monkeypatch.setattr(silent, "file_number", os.pipe()[0])
    links = BusLinks([NamedBus(f"bus {n}", n, can.Bus) for n in (0, 1)], lambda is_error, text: None)
    links.links = [silent, SimpleNamespace(up=True, file_number=reading, look=look)]  # type: ignore[list-item]
    threading.Timer(0.05, os.write, (writing, b"x")).start()
    frames = links.receive(900.0)
    assert frames.channel.tolist() == [1]
    assert waits[0] == 0.0
    assert waits[1] > 0.0


def test_all_buses_that_cannot_be_opened_are_named_and_the_others_closed() -> None:
    made = []

    def connect() -> can.BusABC:
        made.append(open_bus({"interface": "virtual", "channel": "links"}))
        return made[0]

    def missing(name: str) -> can.BusABC:
        raise BusError(f"{name} is not there")

    buses = [NamedBus(name, n, partial(missing, name)) for n, name in enumerate("ab")]
    links = BusLinks([*buses, NamedBus("c", 2, connect)], lambda is_error, text: None)
    with pytest.raises(BusError, match="a is not there\nb is not there"):
        links.open(lambda: False, wait=False)
    assert links.away == ["a", "b", "c"]
    assert not made[0]._open  # type: ignore[attr-defined]


@pytest.fixture
def two_buses(tmp_path: Path) -> Callable[..., Config]:
    """Return the paper car with its brakes on a second bus."""
    number = len(list(tmp_path.iterdir()))

    def load(text: str = "", **output: Any) -> Config:
        (tmp_path / "demo_car.dbc").write_bytes(shipped_dbc("demo_car").read_bytes())
        lines = shipped_config("paper_car").read_text().replace("../dbc/demo_car.dbc", "demo_car.dbc").splitlines()
        at = next(n for n, line in enumerate(lines) if line.startswith("can:"))
        lines[at] = (
            f"can:\n  - {{interface: virtual, channel: '{tmp_path} a{number}'}}\n"
            f"  - {{interface: virtual, channel: '{tmp_path} b{number}', number: 4}}"
        )
        path = tmp_path / "car.yaml"
        path.write_text("\n".join(lines) + "\n" + text)
        return load_config(path, {f"output.{key}": str(value) for key, value in output.items()})

    return load


class Car:
    """Sends the frames of a drive, those of the brakes on the second bus."""

    def __init__(self, config: Config) -> None:
        self.buses = [open_bus(bus.arguments()) for bus in config.buses]

    def send(self, frames: Frames) -> None:
        brakes = np.isin(frames.can_id, BRAKES).tolist()
        for i, second in enumerate(brakes):
            self.buses[second].send(message_from_frame(frames, i))

    def heard(self) -> list[list[int]]:
        result: list[list[int]] = []
        for bus in self.buses:
            result.append([])
            while (message := bus.recv(0.0)) is not None:
                result[-1].append(message.arbitration_id)
        return result

    def close(self) -> None:
        for bus in self.buses:
            bus.shutdown()


def serve(config: Config, log: Path | None, connects: list[Callable[[], can.BusABC]]) -> tuple[Service, list[str]]:
    told: list[str] = []
    plan = None if log is None else plan_for(config, log)
    service = Service(config, connects, plan, lambda is_error, text: told.append(text))
    service.prepare()
    return service, told


def drive_it(service: Service, body: Callable[[], None]) -> Summary:
    summaries: list[Summary] = []
    thread = threading.Thread(target=lambda: summaries.append(service.run()), daemon=True)
    thread.start()
    body()
    service.stop()
    thread.join()
    (summary,) = summaries
    return summary


def wait_for(service: Service, frames: int) -> None:
    while service.received < frames:
        time.sleep(0.002)


def connects_of(config: Config) -> list[Callable[[], can.BusABC]]:
    return [partial(open_bus, bus.arguments()) for bus in config.buses]


def replay(log: Path, config: Config, output: Path) -> ReplayResult:
    with open_log(log) as reader:
        return replay_logs([reader], config, ReplayTargets(output), ReplayContent(), lambda fraction: None)


@pytest.mark.parametrize("channel", [None, 4])
def test_a_service_on_two_buses_logs_what_replays_to_the_same_bits(
    two_buses: Callable[..., Config], drive: SimulatedDrive, folder: Path, channel: int | None
) -> None:
    given = {} if channel is None else {"channel": channel}
    config = two_buses(enabled="true", **given)
    car = Car(config)
    service, told = serve(config, folder / "live.mcap", connects_of(config))

    def body() -> None:
        for start in range(0, len(drive.frames), 100):
            car.send(drive.frames[start : start + 100])
            wait_for(service, start - 300)
        wait_for(service, len(drive.frames))

    summary = drive_it(service, body)
    assert summary.complete
    assert summary.frames == len(drive.frames)
    brakes = int(np.isin(drive.frames.can_id, BRAKES).sum())
    assert [(bus["number"], bus["received"]) for bus in summary.buses] == [
        (0, len(drive.frames) - brakes),
        (4, brakes),
    ]
    assert [bus["name"] for bus in summary.buses] == [str(bus) for bus in config.buses]
    assert all(bus["open"] for bus in summary.buses)
    assert summary.valid_estimates > 2000
    heard = car.heard()
    car.close()
    sent = 0 if channel is None else 1
    assert len(heard[sent]) == summary.published > 500
    assert heard[1 - sent] == []
    with open_log(folder / "live.mcap") as log:
        frames = Frames.concatenate(part.copy() for part in log.frames())
    own = (frames.flags & FrameFlag.SENT) != 0
    assert set(frames.channel[own].tolist()) == {channel or 0}
    got = frames[~own]
    assert (got.channel[np.isin(got.can_id, BRAKES)] == 4).all()
    assert (got.channel[~np.isin(got.can_id, BRAKES)] == 0).all()
    result = replay(folder / "live.mcap", config, folder / "again.mcap")
    assert missing_lines(result.traffic, result.health) == []
    for table in (ESTIMATES, HEALTH):
        live, again = (read_table(folder / name, table) for name in ("live.mcap", "again.mcap"))
        assert len(live) > 5
        assert live.tobytes() == again.tobytes()
    assert [line for line in told if not line.startswith("logging to")] == []


def test_a_bus_that_goes_away_does_not_stop_the_other(
    two_buses: Callable[..., Config], drive: SimulatedDrive, folder: Path
) -> None:
    config = two_buses()
    car = Car(config)
    first, second = connects_of(config)
    gone = threading.Event()
    tries = []

    def unplugged() -> can.BusABC:
        tries.append(0)
        if gone.is_set():
            raise BusError("not there")
        bus = second()
        inner = bus._recv_internal

        def recv(timeout: float | None) -> Any:
            if gone.is_set():
                raise can.CanOperationError("unplugged")
            return inner(timeout)

        bus._recv_internal = recv  # type: ignore[method-assign]
        return bus

    service, told = serve(config, None, [first, unplugged])
    name = str(config.buses[1])
    frames = drive.frames
    engine = frames[~np.isin(frames.can_id, BRAKES)]

    def body() -> None:
        car.send(frames[:500])
        wait_for(service, 500)
        gone.set()
        while name not in service._links.away:
            time.sleep(0.002)
        car.send(engine[500:900])
        wait_for(service, 900)
        while len(tries) < 2:  # the bus that is away is tried again meanwhile
            time.sleep(0.002)
        gone.clear()
        while service._links.away:
            time.sleep(0.002)
        car.send(frames[900:1000])
        wait_for(service, 1000)

    summary = drive_it(service, body)
    car.close()
    assert [bus["lost"] for bus in summary.buses] == [0, 1]
    assert [bus["reconnects"] for bus in summary.buses] == [0, 1]
    assert summary.link.lost == 1
    assert told[0].startswith(f"{name}: the bus is gone: unplugged")
    assert f"{name}: the bus is open again" in told


def test_an_identifier_on_both_buses_is_a_warning_until_a_channel_is_told(
    two_buses: Callable[..., Config], drive: SimulatedDrive, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(service_module, "ORIGINS_S", 0.0)
    for override, expected in ((None, 1), ("0", 0)):
        config = two_buses()
        if override is not None:
            config = load_config(config.path, {"databases.0.channel": override})
        car = Car(config)
        service, told = serve(config, None, connects_of(config))

        def body(car: Car = car, service: Service = service) -> None:
            for i in range(300):
                car.buses[0].send(message_from_frame(drive.frames, i))
                car.buses[1].send(message_from_frame(drive.frames, i))
            wait_for(service, 600)
            time.sleep(0.3)

        drive_it(service, body)
        car.close()
        warnings = [text for text in told if "both carry mapped identifiers" in text]
        assert bool(warnings) == bool(expected)
        if warnings:
            assert warnings[0].startswith("channels 0 and 4 both carry mapped identifiers: 100 EngineData")


def test_somebody_else_counts_on_the_bus_that_is_sent_on_alone(
    two_buses: Callable[..., Config], drive: SimulatedDrive
) -> None:
    config = two_buses(enabled="true")
    ours = [m.frame_id for m in config.output.database.messages]
    car = Car(config)
    service, told = serve(config, None, connects_of(config))

    def body() -> None:
        car.buses[1].send(can.Message(arbitration_id=ours[0], data=bytes(8), is_extended_id=False))
        car.buses[0].send(can.Message(arbitration_id=ours[1], data=bytes(8), is_extended_id=False))
        wait_for(service, 2)

    summary = drive_it(service, body)
    car.close()
    assert summary.refused_ids == [ours[1] & ~EXTENDED_ID]
    assert len(told) == 1


def test_a_server_that_hangs_up_is_noticed_beside_another_bus() -> None:
    """Its interface never raises and is always ready; only one that waits for a while can be seen not to wait."""
    server = SocketCand()
    told: list[str] = []
    other = partial(open_bus, {"interface": "virtual", "channel": "beside a server"})
    buses = [NamedBus("server", 0, server.open_and_speak), NamedBus("other", 1, other)]
    links = BusLinks(buses, lambda is_error, text: told.append(text))
    links.open(lambda: False, wait=False)
    try:
        found: list[int] = []
        while len(found) < 2:
            found += links.receive(0.1).can_id.tolist()
        assert found == [0x123, 0x124]
        server.hang_up()
        while links.links[0].counts.lost == 0:
            links.receive(0.1)
        assert told[0].startswith("server: the bus is gone")
        assert links.links[1].counts.lost == 0
    finally:
        links.close()
        server.close()
