import os
from datetime import UTC, datetime
from pathlib import Path

import pytest

from dctorque_can.config.load import Config
from dctorque_can.daemon.log_plan import LogFolder, LogPlan, plan_for

NOON = datetime(2026, 5, 4, 12, 0, 0, tzinfo=UTC)


def test_names_tell_car_and_time_and_never_repeat(tmp_path: Path) -> None:
    folder = LogFolder(tmp_path, "car")
    first = folder.next_path(0, NOON)
    first.touch()
    second = folder.next_path(1, NOON)
    assert first.name == "car_20260504T120000Z.mcap"
    assert second.name == "car_20260504T120000Z_2.mcap"


def test_an_exact_path_is_used_once(tmp_path: Path) -> None:
    folder = LogFolder(tmp_path, "drive", first=tmp_path / "drive.mcap")
    assert folder.next_path(0, NOON) == tmp_path / "drive.mcap"
    assert folder.next_path(1, NOON).name == "drive_20260504T120000Z.mcap"


@pytest.mark.parametrize(("quota_mb", "kept"), [(0, "abcd"), (0.0035, "bcd"), (0.001, "d")])
def test_the_quota_deletes_the_oldest_but_never_the_current(tmp_path: Path, quota_mb: float, kept: str) -> None:
    for age, letter in enumerate("abcd"):
        path = tmp_path / f"car_{letter}.mcap"
        path.write_bytes(bytes(1000))
        os.utime(path, (1000 + age, 1000 + age))
    (tmp_path / "other_1.mcap").write_bytes(bytes(9000))
    current = tmp_path / "car_d.mcap"
    LogFolder(tmp_path, "car", quota_mb=quota_mb).make_room(current)
    assert "".join(sorted(path.stem[-1] for path in tmp_path.glob("car_*"))) == kept
    assert (tmp_path / "other_1.mcap").exists()


def test_a_plan_survives_the_pipe(config: Config, tmp_path: Path) -> None:
    plan = plan_for(config, tmp_path / "x.mcap")
    assert LogPlan.from_json(plan.as_json()) == plan
    assert plan.flush_s == 0.2
    assert plan.metadata["bus"]["interface"] == "virtual"
