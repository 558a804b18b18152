"""Torn logs are whole again after a start, without a message lost; all other files stay as they are."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dctorque_can.daemon.log import recovery as log_recovery
from dctorque_can.daemon.log.plan import LogFolder
from dctorque_can.daemon.log.quota import mark
from dctorque_can.daemon.log.recovery import LogRecovery, finalise, finalise_all
from dctorque_can.logs.errors import LogWriteError
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import Frames

NAME = "car_20260504T120000Z.mcap"
END = b"\x89MCAP0\r\n"


def frames(n: int, first: int = 0) -> Frames:
    made = Frames.empty(n)
    made.t_us[:] = 1_000_000 + 1000 * (first + np.arange(n))
    made.can_id[:], made.length[:] = 0x100, 8
    made.data[:] = np.random.default_rng(first).integers(0, 256, (n, 8), dtype=np.uint8)
    return made


def write(path: Path, chunks: int = 4, vehicle: str = "car") -> list[int]:
    """Write a log of some chunks with a state, and return where each chunk ends."""
    ends = []
    documents = {"car.yaml": b"a: 1", "estimator.state": b"\0\1state"}
    with McapLog(path, documents=documents, metadata=mark(vehicle, "car", 7)) as log:
        for n in range(chunks):
            log.write_frames(frames(100, 100 * n))
            log._file.flush()
            ends.append(log.written)
    return ends


def times(path: Path) -> list[int]:
    with open_log(path) as log:
        return Frames.concatenate(log.frames()).t_us.tolist()


def folder(path: Path) -> LogFolder:
    return LogFolder(path, "car", vehicle="car")


@pytest.mark.parametrize("behind", [0, 1, 9, 200, 700])
def test_a_torn_log_is_whole_again_and_still_ours(tmp_path: Path, behind: int) -> None:
    """Cut at the end of a chunk or some bytes behind it, and once more: then there is nothing to do."""
    path = tmp_path / NAME
    ends = write(path)
    path.write_bytes(path.read_bytes()[: ends[2] + behind])
    path.chmod(0o640)
    before = times(path)
    ((told_path, is_error, text),) = finalise_all(folder(tmp_path), {})
    assert (told_path, is_error) == (path, False)
    assert "was torn and is whole again" in text
    assert path.read_bytes().endswith(END)
    assert path.stat().st_mode & 0o777 == 0o640
    assert times(path)[: len(before)] == before
    assert len(before) >= 300
    with open_log(path) as log:
        assert log.documents["estimator.state"] == b"\0\1state"
        assert log.problems == []
    assert [log.number for log in folder(tmp_path).own_logs()] == [7]
    assert list(finalise_all(folder(tmp_path), {})) == []
    assert list(tmp_path.iterdir()) == [path]


def test_what_stands_in_the_next_log_is_cut_off(tmp_path: Path) -> None:
    """Also if the log was closed: its writer died after that, and before it could tell."""
    path = tmp_path / NAME
    ends = write(path)
    ((told_path, _, _),) = finalise_all(folder(tmp_path), {str(path): ends[1]})
    assert told_path == path
    assert times(path) == [1_000_000 + 1000 * n for n in range(200)]


def test_a_log_that_is_being_written_is_left_alone(tmp_path: Path) -> None:
    with McapLog(tmp_path / NAME, metadata=mark("car", "car", 1), held=True) as log:
        log.write_frames(frames(10))
        assert list(finalise_all(folder(tmp_path), {})) == []
        with pytest.raises(LogWriteError, match="can not be created"):
            McapLog(tmp_path / NAME, held=True)
    assert times(tmp_path / NAME) == [1_000_000 + 1000 * n for n in range(10)]


def test_files_of_others_and_links_stay_as_they_are(tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    ends = write(tmp_path / "elsewhere.mcap")
    torn = (tmp_path / "elsewhere.mcap").read_bytes()[: ends[1] + 20]
    (tmp_path / "elsewhere.mcap").write_bytes(torn)
    (logs / NAME).symlink_to(tmp_path / "elsewhere.mcap")
    (logs / "car_notes.mcap").write_bytes(torn)
    other = logs / "car_20260504T120001Z.mcap"
    ends = write(other, vehicle="another car")
    other.write_bytes(other.read_bytes()[: ends[1]])
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.mcap")}
    assert list(finalise_all(folder(logs), {})) == []
    with pytest.raises(OSError, match="symbolic"):
        finalise(logs / NAME)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.mcap")} == before


def test_a_log_that_is_damaged_within_stays_as_it_is(tmp_path: Path) -> None:
    """Something of the damaged place might yet be read by somebody else."""
    path = tmp_path / NAME
    ends = write(path)
    content = bytearray(path.read_bytes()[: ends[3] + 5])
    content[ends[0] + 60] ^= 255
    path.write_bytes(content)
    ((told_path, is_error, text),) = finalise_all(folder(tmp_path), {})
    assert (told_path, is_error) == (None, True)
    assert "dctorque recover" in text
    assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_left_of_an_earlier_try_is_removed(tmp_path: Path) -> None:
    path = tmp_path / NAME
    ends = write(path)
    path.write_bytes(path.read_bytes()[: ends[2] + 50])
    (tmp_path / f".{NAME}.part").write_bytes(b"half")
    assert [told for told, _, _ in finalise_all(folder(tmp_path), {})] == [path]
    assert list(tmp_path.iterdir()) == [path]


def test_the_service_hears_of_it(tmp_path: Path) -> None:
    path = tmp_path / NAME
    ends = write(path)
    path.write_bytes(path.read_bytes()[: ends[2] + 50])
    recovery = LogRecovery(folder(tmp_path))
    recovery.begin([])
    told: list[tuple[Path | None, bool, str]] = []
    while not told:
        told += recovery.news()
        time.sleep(0.01)
    assert told[0][0] == path
    recovery.end()


def test_held_files_follow_no_link_and_keep_what_another_writes(tmp_path: Path) -> None:
    (tmp_path / "target").write_bytes(b"kept")
    (tmp_path / "x.mcap").symlink_to(tmp_path / "target")
    with pytest.raises(LogWriteError, match="can not be created"):
        McapLog(tmp_path / "x.mcap", held=True)
    assert (tmp_path / "target").read_bytes() == b"kept"
    with (tmp_path / "target").open("rb+") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(LogWriteError, match="can not be created"):
            McapLog(tmp_path / "target", held=True)
    assert (tmp_path / "target").read_bytes() == b"kept"


def test_files_have_the_mode_that_the_umask_leaves(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        McapLog(tmp_path / "x.mcap", held=True).close()
    finally:
        os.umask(before)
    assert (tmp_path / "x.mcap").stat().st_mode & 0o777 == 0o640


def test_logs_of_this_run_are_left_to_the_service(tmp_path: Path) -> None:
    """It alone knows where one ends whose writer has just died, and a rewritten one would end elsewhere."""
    path = tmp_path / NAME
    ends = write(path)
    torn = path.read_bytes()[: ends[2] + 50]
    path.write_bytes(torn)
    assert list(finalise_all(folder(tmp_path), {}, [str(path)])) == []
    assert path.read_bytes() == torn


def test_a_process_that_cannot_be_started_is_told_and_started_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / NAME
    ends = write(path)
    path.write_bytes(path.read_bytes()[: ends[2] + 9])
    started, failures = subprocess.Popen, iter([OSError(errno.EAGAIN, "Resource temporarily unavailable")])

    def start(*arguments: Any, **options: Any) -> object:
        if error := next(failures, None):
            raise error
        return started(*arguments, **options)

    monkeypatch.setattr(log_recovery.subprocess, "Popen", start)
    monkeypatch.setattr(log_recovery, "_RETRY_S", 0.0)
    recovery = LogRecovery(folder(tmp_path))
    recovery.begin([])
    told: list[tuple[Path | None, bool, str]] = []
    while len(told) < 2:
        told += recovery.news()
        time.sleep(0.01)
    recovery.end()
    assert told[0] == (None, True, "torn logs cannot be closed yet: Resource temporarily unavailable")
    assert told[1][0] == path
