"""The free space is kept, by deleting what may go or by writing nothing more; who may write there is told."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from dctorque_can.config.load import Config
from dctorque_can.daemon.log import disk as log_disk
from dctorque_can.daemon.log.disk import Disk, doubtful_owner
from dctorque_can.daemon.log.plan import LogFolder, LogPlan, plan_for
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.log.quota import mark
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.mcap.writer import McapLog


def plan(folder: Path, least_free_mb: float, quota_mb: float = 0.0, fsync_s: float = 0.0) -> LogPlan:
    logs = LogFolder(folder, "car", vehicle="car", quota_mb=quota_mb)
    return LogPlan(logs, 0.2, 0, 0, False, {}, fsync_s=fsync_s, least_free_mb=least_free_mb)


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, object]]:
    found: list[dict[str, object]] = []
    monkeypatch.setattr(log_disk, "report", lambda **words: found.append(words))
    return found


@pytest.fixture
def disk_of(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path, int], None]:
    """A disk of so many bytes, on which there is nothing but the logs of a folder."""

    def make(folder: Path, total: int) -> None:
        def free(path: Path) -> SimpleNamespace:
            used = sum(file.stat().st_size for file in folder.iterdir())
            return SimpleNamespace(f_bavail=max(total - used, 0), f_frsize=1)

        monkeypatch.setattr(os, "statvfs", free)

    return make


def logs(folder: Path, count: int) -> list[Path]:
    paths = [folder / f"car_20260504T12000{n}Z.mcap" for n in range(count)]
    for number, path in enumerate(paths, 1):
        with McapLog(path, metadata=mark("car", "car", number)) as log:
            log.write_event(1, 2, "x", "x" * 100_000)  # type: ignore[arg-type]
        with path.open("ab") as file:
            file.write(bytes(100_000 - path.stat().st_size))
    return paths


def test_the_oldest_logs_go_for_the_free_space_where_logs_may_be_deleted(
    tmp_path: Path, told: list[dict[str, object]], disk_of: Callable[[Path, int], None]
) -> None:
    """0.55 MB with five logs of 0.1: 0.05 are free, so two must go for 0.2."""
    paths = logs(tmp_path, 5)
    disk_of(tmp_path, 550_000)
    wanted = plan(tmp_path, 0.2, quota_mb=100.0)
    Disk(wanted).check(tmp_path, wanted.folder.own_logs())
    assert sorted(tmp_path.iterdir()) == paths[2:]
    assert told == [{"deleted": str(path), "to_keep": "the free space"} for path in paths[:2]]


def test_nothing_goes_and_nothing_more_is_written_where_no_log_may_be_deleted(
    tmp_path: Path, told: list[dict[str, object]], disk_of: Callable[[Path, int], None]
) -> None:
    paths = logs(tmp_path, 3)
    disk_of(tmp_path, 310_000)
    wanted = plan(tmp_path, 0.2)
    with pytest.raises(DctorqueError, match=r"less is free than logging.least_free_mb = 0.2 MB"):
        Disk(wanted).check(tmp_path, wanted.folder.own_logs())
    assert sorted(tmp_path.iterdir()) == paths
    assert told == []


def test_the_log_that_is_being_written_does_not_go(
    tmp_path: Path, told: list[dict[str, object]], disk_of: Callable[[Path, int], None]
) -> None:
    paths = logs(tmp_path, 3)
    disk_of(tmp_path, 310_000)
    given_up: list[str] = []
    with McapLog(tmp_path / "other.mcap") as log:
        Disk(plan(tmp_path, 0.3, quota_mb=100.0)).look(10.0, log, given_up.append)
    assert paths[2].exists()
    assert not paths[0].exists()
    assert not paths[1].exists()
    assert len(given_up) == 1


def test_a_service_without_free_space_estimates_on_and_counts(config: Config, tmp_path: Path) -> None:
    """No disk is that large: the first log is an error, as any that cannot be begun."""
    wanted = replace(plan_for(config, tmp_path / "x.mcap"), least_free_mb=1e12)
    process = LogProcess(wanted, config.documents)
    with pytest.raises(DctorqueError, match="least_free_mb"):
        process.open()
    assert list(tmp_path.iterdir()) == []


def test_the_disk_takes_everything_at_the_interval(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a thread of its own; the next one is begun when that is over, and closing waits for it."""
    synced: list[float] = []
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(os.fstat(number).st_size))
    disk = Disk(plan(tmp_path, 0.0, fsync_s=5.0))
    with McapLog(tmp_path / "x.mcap") as log:
        for now_s in (10.0, 12.0, 14.9, 15.0, 19.0, 20.5):
            disk.look(now_s, log, pytest.fail)
            while disk._syncing is not None and not disk._syncing.done():
                time.sleep(0.001)
    disk.settle()
    assert len(synced) == 3


def test_a_disk_that_does_not_take_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(number: int) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", fails)
    disk, given_up = Disk(plan(tmp_path, 0.0, fsync_s=1.0)), list[str]()
    with McapLog(tmp_path / "x.mcap") as log:
        disk.look(10.0, log, given_up.append)
        assert disk._syncing is not None
        while not disk._syncing.done():
            time.sleep(0.001)
        disk.look(11.0, log, given_up.append)
    assert given_up == [f"{tmp_path / 'x.mcap'}: Input/output error"]


@pytest.mark.parametrize(("mode", "doubtful"), [(0o755, False), (0o775, False), (0o757, True), (0o1777, True)])
def test_a_folder_that_everybody_may_write_to_is_told_with_the_remedy(
    tmp_path: Path, mode: int, doubtful: bool
) -> None:
    tmp_path.chmod(mode)
    text = doubtful_owner(tmp_path)
    assert ("everybody may write" in text) == doubtful
    assert ("chmod" in text) == doubtful


def test_a_folder_of_somebody_else_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: tmp_path.stat().st_uid + 1)
    monkeypatch.setattr(Path, "stat", lambda self: SimpleNamespace(st_uid=4711, st_mode=0o40755))
    assert "belongs to another user (number 4711)" in doubtful_owner(tmp_path)
