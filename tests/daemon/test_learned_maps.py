"""The service learns the maps, keeps them over a restart, logs and sends them; a replay gives the same bits."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import can
import pytest

from dctorque_can.bus.database import DatabaseFile, load_database
from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.kept_maps import MAPS, state_name, state_of
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.resources import shipped_config, shipped_dbc

from .test_service import replayed, send, start

Connect = Callable[[], can.BusABC]


@pytest.fixture
def learning(config: Config, tmp_path: Path) -> Config:
    """The paper's car, whose maps are told each second."""
    changes = {
        "can.interface": "virtual",
        "can.channel": str(config.can.channel),
        "output.enabled": "true",
        "clutch_map.enabled": "true",
        "clutch_map.period_s": "1",
        "state.directory": str(tmp_path / "state"),
    }
    return load_config(shipped_config("paper_car"), changes)


def run(config: Config, connect: Connect, drive: SimulatedDrive, log: Path):
    live = start(config, connect, log)
    send(connect, drive.frames)
    live.wait_for(len(drive.frames))
    return live.stop(), live.told


def test_two_runs_and_their_replays(
    learning: Config, connect: Connect, drive: SimulatedDrive, tmp_path: Path
) -> None:
    first, told = run(learning, connect, drive, tmp_path / "first.mcap")
    file = tmp_path / "state" / state_name(learning)
    assert first.clutch_map is not None
    assert first.clutch_map["start"] == "new"
    one = first.clutch_map["clutches"][0]
    assert one["taken"] > 20
    kept = file.read_bytes()

    later = replace(drive, frames=replace(drive.frames, t_us=drive.frames.t_us + 60_000_000))
    second, more = run(learning, connect, later, tmp_path / "second.mcap")
    assert second.clutch_map is not None
    assert second.clutch_map["start"] == "kept"
    assert second.clutch_map["clutches"][0]["taken"] > one["taken"]
    assert not [line for line in (*told, *more) if "map" in line]

    for name in ("first", "second"):
        live = read_table(tmp_path / f"{name}.mcap", MAPS)
        again = read_table(replayed(tmp_path / f"{name}.mcap", learning, tmp_path / "again.mcap"), MAPS)
        assert len(live) >= 12  # each second and at the end, of both clutches
        assert live.tobytes() == again.tobytes()
    with open_log(tmp_path / "second.mcap") as log:
        assert state_of(log.documents) == kept
    with open_log(tmp_path / "first.mcap") as log:
        assert state_of(log.documents) is None


def test_the_maps_are_sent(learning: Config, connect: Connect, drive: SimulatedDrive) -> None:
    names = {m.frame_id: m.name for m in load_database([DatabaseFile(shipped_dbc("dctorque_map"))]).messages}
    heard: list[int] = []
    live = start(learning, connect, None)
    with connect() as ear:
        send(connect, drive.frames)
        live.wait_for(len(drive.frames))
        summary = live.stop()
        while (message := ear.recv(0.0)) is not None:
            heard.append(message.arbitration_id)
    counts = {name: heard.count(number) for number, name in names.items()}
    assert counts["DctClutchMap"] > 200  # 50 a second, from the first map on
    assert min(counts.values()) >= 4
    assert summary.refused_ids == []


def test_a_state_of_another_car_is_put_aside(
    learning: Config, connect: Connect, drive: SimulatedDrive, tmp_path: Path
) -> None:
    file = tmp_path / "state" / state_name(learning)
    file.parent.mkdir()
    file.write_text("{}")
    live = start(learning, connect, None)
    summary = live.stop()
    assert summary.clutch_map == {"start": "new", "clutches": []}
    assert any(line.startswith(f"{file}: it is of another format") for line in live.told)
    assert file.with_name(file.name + ".bad1").read_text() == "{}"


def test_without_the_key_nothing_is_learned(config: Config, connect: Connect) -> None:
    assert start(config, connect, None).stop().clutch_map is None
