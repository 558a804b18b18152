"""The same car with identifiers of J1939, from other senders than its DBC names."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from dctorque_can.config.load import Config, ConfigError, load_config
from dctorque_can.config.overview import input_rows
from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.replay import ReplayContent, ReplayResult, ReplayTargets, replay_logs
from dctorque_can.offline.simulated_car import DriveName, ProfileName, SimulatedDrive, simulate_car
from dctorque_can.pipeline.frames import EXTENDED_ID, Frames
from dctorque_can.report.traffic_lines import missing_lines
from dctorque_can.resources import shipped_config

from ..bus.j1939_car import IDS, j1939_dbc

Car = Callable[..., Path]


@pytest.fixture
def car(tmp_path: Path) -> Car:
    """Write the paper car with a DBC of J1939."""

    def write(declared: bool, protected_as: Callable[[int], int] = lambda can_id: can_id, **keys: Any) -> Path:
        (tmp_path / "j1939.dbc").write_text(j1939_dbc(declared=declared))
        data = yaml.safe_load(shipped_config("paper_car").read_text())
        data["databases"] = [{"file": "j1939.dbc"} | keys]
        for each in data["protection"].values():
            each["data_id"] = protected_as(each["data_id"])
        path = tmp_path / "car.yaml"
        path.write_text(yaml.safe_dump(data))
        return path

    return write


def as_j1939(frames: Frames, source: int | None = None) -> Frames:
    """Return frames of the demo car as J1939 has them, of another priority, maybe from elsewhere."""
    result = frames.copy()
    for standard, extended in IDS.items():
        can_id = (extended & ~0x1C00_0000) | 0x0400_0000 | EXTENDED_ID
        result.can_id[frames.can_id == standard] = can_id if source is None else (can_id & ~0xFF) | source
    return result


def replay(config: Config, frames: Frames, path: Path) -> tuple[ReplayResult, bytes]:
    log = path.with_name(f"{path.stem}-in.blf")
    write_frames(log, frames)
    with open_log(log) as reader:
        result = replay_logs([reader], config, ReplayTargets(path), ReplayContent(), lambda fraction: None)
    return result, read_table(path, ESTIMATES).tobytes()


def told(result: ReplayResult) -> list[str]:
    return missing_lines(result.traffic, result.health)


def test_estimates_are_those_of_the_car_with_11_bits(
    config: Config, drive: SimulatedDrive, car: Car, tmp_path: Path
) -> None:
    _, expected = replay(config, drive.frames, tmp_path / "a.mcap")
    for path in (car(True), car(False, j1939=True)):
        result, rows = replay(load_config(path), as_j1939(drive.frames, 0x42), tmp_path / "b.mcap")
        assert rows == expected
        assert told(result) == []


def test_a_log_from_elsewhere_gives_a_hint(drive: SimulatedDrive, car: Car, tmp_path: Path) -> None:
    moved = as_j1939(drive.frames, 0x42)
    for keys, hint in (
        ({}, "is this J1939? Then say `j1939: true` of the database"),
        ({"j1939": True, "source_addresses": dict.fromkeys(MESSAGES, 33)}, "`source_addresses:` of the database"),
    ):
        result, _ = replay(load_config(car(False, **keys)), moved, tmp_path / "out.mcap")
        first, *hints = told(result)
        assert first.startswith(f"none of the {len(moved)} frames has a mapped identifier")
        assert len(hints) == 5
        assert "EngineData: none came, but of its J1939 parameter group 4FF1042x (700): " in hints[0]
        assert all(line.endswith(hint) for line in hints)


MESSAGES = ("EngineData", "InputShafts", "Gearbox", "WheelSpeedsFront", "WheelSpeedsRear")


def test_two_senders_are_a_warning_until_one_is_told(drive: SimulatedDrive, car: Car, tmp_path: Path) -> None:
    frames = as_j1939(drive.frames)
    engine = frames.can_id == 0x04FF1000 | EXTENDED_ID
    copy = frames[engine].copy()
    copy.can_id[:] |= 0x21
    copy.data[:, 2:] = 0
    both = Frames.concatenate([frames, copy]).sorted_by_time()
    result, _ = replay(load_config(car(True)), both, tmp_path / "a.mcap")
    (line,) = told(result)
    assert line.startswith("source addresses 0x00 and 0x21 both send CFF1000x EngineData; frames of all")
    _, expected = replay(load_config(car(True)), frames, tmp_path / "b.mcap")
    result, rows = replay(load_config(car(True, source_addresses={"EngineData": 0})), both, tmp_path / "c.mcap")
    assert told(result) == []
    assert rows == expected


@pytest.mark.parametrize("sources", [{}, {"EngineData": 0x11, "Gearbox": 0x12}])
def test_what_the_simulated_car_sends_comes_in(car: Car, tmp_path: Path, sources: dict[str, int]) -> None:
    protected_as = {standard: extended & 0xFFFF for standard, extended in IDS.items()}
    config = load_config(car(True, protected_as.__getitem__, source_addresses=sources, channel=2))
    made = simulate_car(config, DriveName.PAPER, ProfileName.PRODUCTION, seed=3, duration_s=4.0)
    told_of = {row["quantity"]: row["taken_from"] for row in input_rows(config) if row["present"]}
    assert told_of["engine_speed"] == ["J1939 65296 from 0x11, channel 2" if sources else "J1939 65296, channel 2"]
    ids = set(made.frames.can_id.tolist())
    assert ids == {
        (can_id & ~0xFF | sources.get(name, can_id & 0xFF)) | EXTENDED_ID
        for name, can_id in zip(MESSAGES, IDS.values(), strict=True)
    }
    assert np.all(made.frames.channel == 2)
    result, _ = replay(config, made.frames, tmp_path / "out.mcap")
    assert result.valid_estimates > 0.9 * result.estimates > 1000
    assert result.health.get("bad_frames", 0) == 0
    assert told(result) == []


def test_errors_of_the_keys(car: Car) -> None:
    path = car(False, source_addresses={"EngineData": 300, "EngineDat": 3}, j1939=False)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    said = "\n".join(str(problem) for problem in caught.value.problems)
    assert "databases.0.source_addresses.EngineData = 300" in said
    path = car(False, source_addresses={"EngineData": 3, "EngineDat": 3, "Inertial": 3})
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    said = "\n".join(str(problem) for problem in caught.value.problems)
    assert "EngineData = 3: the DBC does not say that EngineData is a message of J1939: add j1939: true" in said
    assert "EngineDat = 3: j1939.dbc has no such message; did you mean EngineData?" in said
    assert "Inertial = 3: Inertial has an identifier of 11 bits" in said
    with pytest.raises(ConfigError, match="leave j1939: false out"):
        load_config(car(True, source_addresses={"EngineData": 3}, j1939=False))
