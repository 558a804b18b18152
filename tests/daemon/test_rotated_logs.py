"""Each log of a service replays alone to the estimates that are in it, wherever one ends and the next begins."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import can
import pytest

from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.log.plan import STATE_NAME, LogPlan, plan_for
from dctorque_can.daemon.service import Service, Summary
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH, Table
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.replay import ReplayContent, ReplayResult, ReplayTargets, replay_logs
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.resources import shipped_config

Connect = Callable[[], can.BusABC]


def served(config: Config, connect: Connect, plan: LogPlan, drive: SimulatedDrive) -> tuple[Service, Summary]:
    """Send a drive in small pieces, with a new log now and then, and return the service and what it did."""
    service = Service(config, [connect], plan, lambda is_error, text: None)
    service.prepare()
    summaries: list[Summary] = []
    thread = threading.Thread(target=lambda: summaries.append(service.run()), daemon=True)
    thread.start()
    with connect() as bus:
        for i in range(len(drive.frames)):
            bus.send(message_from_frame(drive.frames, i))
            if i % 200 == 199:
                while service.received < i + 1:
                    assert thread.is_alive()
                    time.sleep(0.001)
            if i % 3000 == 1500:
                service.rotate()
        while service.received < len(drive.frames):
            time.sleep(0.001)
    service.stop()
    thread.join()
    return service, summaries[0]


def replayed(path: Path, config: Config, output: Path) -> ReplayResult:
    with open_log(path) as log:
        return replay_logs([log], config, ReplayTargets(output), ReplayContent(frames=True), lambda fraction: None)


def assert_each_replays_alone(paths: list[Path], config: Config, folder: Path) -> int:
    """Replay each log on its own against what is in it, and return the number of estimates of all."""
    folder.mkdir()
    count = 0
    for n, path in enumerate(paths):
        result = replayed(path, config, folder / f"{n}.mcap")
        assert result.state == ("" if n else None)
        assert result.problems == []
        for table in (ESTIMATES, HEALTH):
            assert rows_of(path, table) == rows_of(folder / f"{n}.mcap", table)
        count += result.estimates
    return count


def rows_of(path: Path, table: Table) -> bytes:
    """Return the rows of a table; a log that ended at once has none."""
    try:
        return read_table(path, table).tobytes()
    except LogReadError:
        return b""


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"estimator.method": "oh2014"},
        {"inputs.engine_speed.delay_ms": "20"},
        {"clutch_map.enabled": "true"},
    ],
)
def test_each_rotated_log_replays_alone_to_the_same_bits(
    config: Config, connect: Connect, drive: SimulatedDrive, folder: Path, tmp_path: Path, more: dict[str, str]
) -> None:
    channel = str(config.can.channel)
    settings = {"can.interface": "virtual", "can.channel": channel, "output.enabled": "true", **more}
    config = load_config(shipped_config("paper_car"), settings)
    plan = replace(plan_for(config, folder / "x.mcap"), rotate_mb=0.2, flush_s=0.05)
    _, summary = served(config, connect, plan, drive)
    assert summary.complete
    assert summary.log is not None
    paths = summary.log.paths
    assert len(paths) > len(drive.frames) // 3000
    assert assert_each_replays_alone(paths, config, tmp_path / "again") == summary.estimates
    with open_log(paths[0]) as first, open_log(paths[1]) as second:
        assert STATE_NAME not in first.documents
        assert STATE_NAME in second.documents


def test_a_state_of_another_vehicle_file_is_told_and_not_used(
    config: Config, connect: Connect, drive: SimulatedDrive, folder: Path, tmp_path: Path
) -> None:
    plan = replace(plan_for(config, folder / "x.mcap"), rotate_mb=0.5, flush_s=0.05)
    _, summary = served(config, connect, plan, drive)
    assert summary.log is not None
    second = summary.log.paths[1]
    other = load_config(shipped_config("paper_car"), {"vehicle.chassis.mass_kg": "1700"})
    result = replayed(second, other, tmp_path / "again.mcap")
    assert result.state == "it is of another vehicle file"
    assert result.estimates
