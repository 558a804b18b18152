"""Only logs that this service wrote count and go, whatever else lies beside them and whatever the clock said."""

import os
from pathlib import Path

import pytest

from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.log.plan import LogPlan, plan_for
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.log.quota import OwnLog, make_room, mark, own_logs
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.resources import shipped_config


def write(path: Path, number: int = 1, vehicle: str = "car", stem: str = "car") -> Path:
    with McapLog(path, metadata=mark(vehicle, stem, number)) as log:
        log.write_event(1, 2, "x", "x")  # type: ignore[arg-type]
    return path


def name(seconds: int, stem: str = "car", more: str = "") -> str:
    return f"{stem}_20260504T1200{seconds:02d}Z{more}.mcap"


def names(logs: list[OwnLog]) -> list[str]:
    return [log.path.name for log in logs]


@pytest.mark.parametrize(
    "foreign",
    [
        "car_2_20260504T120000Z.mcap",  # of a vehicle "car 2"
        "car_notes.mcap",
        "car_20260504T120000Z_best.mcap",
        "car_20260504T120000Z.mcap.bak",
        "my_car_20260504T120000Z.mcap",
        "car_20260504T120000Z_recovered.mcap",
        "car.mcap",
    ],
)
def test_another_name_is_not_ours_even_if_the_content_is(tmp_path: Path, foreign: str) -> None:
    write(tmp_path / foreign)
    assert own_logs(tmp_path, "car", "car") == []


def test_a_name_like_ours_with_another_content_is_not_ours(tmp_path: Path) -> None:
    write(tmp_path / name(1), vehicle="car!", stem="car_")
    write(tmp_path / name(2), vehicle="another car", stem="car")
    with McapLog(tmp_path / name(3)) as log:  # converted, or simulated
        log.write_event(1, 2, "x", "x")  # type: ignore[arg-type]
    (tmp_path / name(4)).write_bytes(bytes(1000))
    (tmp_path / name(5)).touch()
    (tmp_path / name(6)).write_text("notes")
    assert own_logs(tmp_path, "car", "car") == []


def test_links_and_directories_are_not_ours(tmp_path: Path) -> None:
    elsewhere = write(tmp_path / "elsewhere.mcap")
    folder = tmp_path / "logs"
    folder.mkdir()
    (folder / name(1)).symlink_to(elsewhere)
    (folder / name(2)).mkdir()
    os.mkfifo(folder / name(3))
    assert own_logs(folder, "car", "car") == []


def test_a_torn_log_is_ours(tmp_path: Path) -> None:
    path = write(tmp_path / name(1))
    whole = path.read_bytes()
    path.write_bytes(whole[:200] + bytes(3000))
    assert own_logs(tmp_path, "car", "car") == [OwnLog(path, 3200, 1)]


def test_logs_come_in_the_order_in_which_they_were_begun_whatever_the_clock_said(tmp_path: Path) -> None:
    """The clock was set back by some days after the second log."""
    for number, day in enumerate((10, 11, 3, 4), 1):
        path = write(tmp_path / f"car_202605{day:02d}T120000Z.mcap", number)
        os.utime(path, (day * 86400, day * 86400))
    assert [log.number for log in own_logs(tmp_path, "car", "car")] == [1, 2, 3, 4]


@pytest.mark.parametrize(("quota", "gone"), [(4000, ""), (3999, "1"), (3000, "1"), (2999, "12"), (0, "1234")])
def test_the_first_go_until_the_rest_keeps_the_quota(tmp_path: Path, quota: float, gone: str) -> None:
    logs = [OwnLog(tmp_path / f"{number}", 1000, number) for number in (1, 2, 3, 4)]
    for log in logs:
        log.path.touch()
    went, failures = make_room(logs, quota)
    assert "".join(path.name for path in went) == gone
    assert failures == []
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(set("1234") - set(gone))


def test_a_log_that_cannot_be_deleted_is_told_and_the_next_one_goes(tmp_path: Path) -> None:
    stuck = tmp_path / "stuck"
    stuck.mkdir()
    (tmp_path / "2").touch()
    went, failures = make_room([OwnLog(stuck, 1000, 1), OwnLog(tmp_path / "2", 1000, 2)], 1000)
    assert went == [tmp_path / "2"]
    assert len(failures) == 1
    assert str(stuck) in failures[0]


def test_the_service_keeps_its_quota_and_leaves_all_other_files(tmp_path: Path) -> None:
    config = load_config(shipped_config("paper_car"), {"logging.directory": str(tmp_path)})
    plan = plan_for(config)
    stem = plan.folder.stem
    kept = [tmp_path / name(1, f"{stem}_2"), tmp_path / name(2, stem), tmp_path / f"{stem}_notes.mcap"]
    for path in kept:
        path.write_bytes(bytes(100_000))
    opened = rotated(config, with_quota(plan, 1e-6), 3)
    assert sorted(tmp_path.iterdir()) == sorted([*kept, opened[-1]])
    opened += rotated(config, with_quota(plan, 0.0), 2)
    assert sorted(tmp_path.iterdir()) == sorted([*kept, *opened[2:]])
    assert [log.number for log in own_logs(tmp_path, config.name, stem)] == [3, 4, 5]


def with_quota(plan: LogPlan, quota_mb: float) -> LogPlan:
    return LogPlan.from_json(plan.as_json() | {"quota_mb": quota_mb})


def rotated(config: Config, plan: LogPlan, logs: int) -> list[Path]:
    process = LogProcess(plan, config.documents)
    process.open()
    for _ in range(logs - 1):
        process.rotate()
    process.close()
    return process.counts.paths
