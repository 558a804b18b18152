"""The log writer is killed, starved and filled up; every frame is either in a log or counted as missing."""

import os
import resource
import select
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dctorque_can.config.load import Config
from dctorque_can.daemon.log import process as log_process
from dctorque_can.daemon.log.plan import STATE_NAME, LogPlan, plan_for
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.log.protocol import Kind, frames_message, message
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import Frames

BATCH = 500


def batch(number: int) -> bytes:
    frames = Frames.empty(BATCH)
    frames.t_us[:] = np.arange(BATCH) * 1000 + (1 + number) * 1_000_000
    frames.can_id[:] = 0x100
    frames.length[:] = 8
    frames.data[:] = np.random.default_rng(number).integers(0, 256, (BATCH, 8), dtype=np.uint8)
    return frames_message(frames)


def confirmed(process: LogProcess, frames: int) -> None:
    """Wait until the operating system has so many frames: safe from here on."""
    process.flush()
    wait_until(process, f"counts.written >= {frames}")
    assert process.counts.written == frames


def frames_in(path: Path) -> int:
    with open_log(path) as log:
        return sum(len(frames) for frames in log.frames())


def times_in(path: Path) -> list[int]:
    with open_log(path) as log:
        return Frames.concatenate(log.frames()).t_us.tolist()


def wait_until(process: LogProcess, condition: str) -> None:
    while not eval(condition, {"counts": process.counts}):
        process.pump()
        time.sleep(0.01)


@pytest.fixture
def plan(config: Config, folder: Path) -> LogPlan:
    return plan_for(config, folder / "x.mcap")


@pytest.fixture
def process(config: Config, plan: LogPlan) -> Iterator[LogProcess]:
    process = LogProcess(plan, config.documents)
    process.open()
    yield process
    process.close()


def worker_pid(process: LogProcess) -> int:
    assert process._process is not None
    return process._process.pid


def test_everything_handed_over_is_written(process: LogProcess, config: Config) -> None:
    for number in range(20):
        process.hand_over(batch(number), BATCH)
        process.pump()
    process.close()
    assert process.counts.written == 20 * BATCH
    assert process.counts.dropped == 0
    (path,) = process.counts.paths
    assert frames_in(path) == 20 * BATCH
    with open_log(path) as log:
        assert log.documents == config.documents


def test_a_killed_writer_is_replaced_and_nothing_is_missing_or_doubled(process: LogProcess) -> None:
    """What it had not confirmed goes to the next one, with the state of the last confirmed point."""
    process.hand_over(batch(0), BATCH)
    process.flush(lambda: b"state 0")
    wait_until(process, f"counts.written == {BATCH}")
    process.hand_over(batch(1), BATCH)
    process.pump()
    time.sleep(0.3)  # it is flushed, but nobody has asked for that
    os.kill(worker_pid(process), signal.SIGKILL)
    process.hand_over(batch(2), BATCH)
    wait_until(process, "counts.restarts == 1 and len(counts.paths) == 2 and counts.finalised")
    process.hand_over(batch(3), BATCH)
    process.close()
    first, second = process.counts.paths
    assert times_in(first) == [1_000_000 + 1000 * n for n in range(BATCH)]
    assert times_in(second) == [k * 1_000_000 + 1000 * n for k in (2, 3, 4) for n in range(BATCH)]
    assert process.counts.finalised == [first]
    assert (process.counts.written, process.counts.dropped) == (4 * BATCH, 0)
    with open_log(second) as log:
        assert log.documents[STATE_NAME] == b"state 0"


def test_writers_that_are_killed_while_they_start_leave_no_log_behind(
    process: LogProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last one gets everything, once, in one log."""
    monkeypatch.setattr(log_process, "RESTART_S", 0.0)
    process.hand_over(batch(0), BATCH)
    for number in range(1, 5):
        os.kill(worker_pid(process), signal.SIGKILL)
        wait_until(process, f"counts.restarts == {number}")
        process.hand_over(batch(number), BATCH)
    process.close()
    first, second = process.counts.paths
    assert times_in(first) == []
    assert times_in(second) == [k * 1_000_000 + 1000 * n for k in range(1, 6) for n in range(BATCH)]
    assert (process.counts.written, process.counts.dropped) == (5 * BATCH, 0)


def test_a_writer_that_dies_again_and_again_does_not_get_the_same_for_ever(
    process: LogProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is handed over may be what kills it: after the fifth time it goes, and a new log begins."""
    monkeypatch.setattr(log_process, "RESTART_S", 0.0)
    process.hand_over(message(Kind.TABLE, b"no table\0"), 7)
    wait_until(process, "counts.restarts == 5")
    assert process.counts.dropped == 7
    assert process.wants_new(time.monotonic())
    process.rotate(lambda: b"state")
    process.hand_over(batch(0), BATCH)
    confirmed(process, BATCH)
    process.close()
    assert frames_in(process.counts.paths[-1]) == BATCH


def test_a_log_is_closed_after_the_death_of_the_service(process: LogProcess) -> None:
    """The frames of the last moment are not confirmed yet, and nobody is there to be told."""
    process.hand_over(batch(0), BATCH)
    process.pump()
    writer, process._process = process._process, None
    process._unconfirmed.clear()  # else another one would be started for it
    assert writer is not None
    assert writer.stdin is not None
    assert writer.stdout is not None
    writer.stdout.close()
    writer.stdin.close()
    assert writer.wait() == 0
    (path,) = process.counts.paths
    assert path.read_bytes().endswith(b"\x89MCAP0\r\n")
    assert frames_in(path) == BATCH


def test_a_stopped_writer_never_holds_up_the_service(process: LogProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever waits for a writer that stands still waits for ever; whoever waits for a while is caught at it."""

    def waits(*arguments: object) -> None:
        pytest.fail("the service waits for the log writer")

    pid = worker_pid(process)
    os.kill(pid, signal.SIGSTOP)
    try:
        with monkeypatch.context() as patch:
            patch.setattr(time, "sleep", waits)
            patch.setattr(select, "select", waits)
            for number in range(3000):  # 17 MB: more than any pipe takes
                process.hand_over(batch(number % 4), BATCH)
                process.pump()
    finally:
        os.kill(pid, signal.SIGCONT)
    assert process.waiting_bytes > 3000 * len(batch(0)) / 2
    process.close()
    assert process.counts.written + process.counts.dropped == 3000 * BATCH


def test_a_full_disk_is_told_and_counted(process: LogProcess) -> None:
    """The file size limit of the writer stands for the end of the disk."""
    resource.prlimit(worker_pid(process), resource.RLIMIT_FSIZE, (100_000, 100_000))
    process.hand_over(batch(0), BATCH)
    confirmed(process, BATCH)
    for number in range(1, 40):
        process.hand_over(batch(number), BATCH)
        process.pump()
    wait_until(process, "counts.failures")
    process.close()
    assert "x.mcap" in process.counts.failures[0]
    assert "File too large" in process.counts.failures[0]
    assert process.counts.dropped > 0
    assert process.counts.written + process.counts.dropped == 40 * BATCH
    logs = [path for path in process.counts.paths if path.exists()]  # an empty one is removed
    assert sum(frames_in(path) for path in logs) >= process.counts.written > 0


def test_a_full_disk_leaves_no_empty_file(process: LogProcess, folder: Path) -> None:
    process.hand_over(batch(0), BATCH)
    confirmed(process, BATCH)
    resource.prlimit(worker_pid(process), resource.RLIMIT_FSIZE, (0, 0))
    for _ in range(3):
        process.rotate()
    process.close()
    assert process.counts.failures
    assert [path.name for path in folder.iterdir()] == ["x.mcap"]


def test_rotation_by_hand_makes_two_whole_logs(process: LogProcess) -> None:
    process.hand_over(batch(0), BATCH)
    process.rotate()
    process.hand_over(batch(1), BATCH)
    process.close()
    assert [frames_in(path) for path in process.counts.paths] == [BATCH, BATCH]


def test_logs_rotate_by_size(config: Config, folder: Path) -> None:
    plan = plan_for(config, folder / "x.mcap")
    small = LogPlan(plan.folder, flush_s=0.05, rotate_mb=0.05, rotate_s=0, signals=False, metadata={})
    process = LogProcess(small, config.documents)
    process.open()
    for number in range(4):
        process.hand_over(batch(number), BATCH)
        confirmed(process, BATCH * (number + 1))
        if process.wants_new(time.monotonic()):
            process.rotate()
    process.close()
    assert len(process.counts.paths) >= 3
    assert sum(frames_in(path) for path in process.counts.paths) == 4 * BATCH


def test_a_log_that_cannot_be_created_is_one_clear_error(config: Config) -> None:
    process = LogProcess(plan_for(config, Path("/proc/nowhere/x.mcap")), config.documents)
    with pytest.raises(DctorqueError, match="/proc/nowhere"):
        process.open()


def test_decoded_signals_are_written_on_request(config: Config, folder: Path, drive: object) -> None:
    from dctorque_can.logs.mcap.reader import read_table

    plan = plan_for(config, folder / "x.mcap")
    process = LogProcess(LogPlan(plan.folder, 0.2, 0, 0, True, {}), config.documents)
    process.open()
    process.hand_over(frames_message(drive.frames[:400]), 400)  # type: ignore[attr-defined]
    process.close()
    rows = read_table(folder / "x.mcap", "/signals/EngineData")
    assert len(rows) == 100
    assert 700 < rows["engine_speed"][0] < 900  # rpm, idling
