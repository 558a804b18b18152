"""A service whose log cannot be begun estimates without one, says so, and tries again."""

import errno
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.log import process as log_process
from dctorque_can.daemon.log.plan import plan_for
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.log.protocol import frames_message
from dctorque_can.daemon.service import Service, Summary
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config


@pytest.fixture
def no_folder(tmp_path: Path) -> Path:
    """A file where the folder of the logs should be, as on a disk that was not mounted."""
    path = tmp_path / "logs"
    path.write_text("in the way")
    return path


@pytest.fixture
def without(config: Config, no_folder: Path) -> Config:
    of_bus = {"can.interface": "virtual", "can.channel": str(config.can.channel)}
    return load_config(shipped_config("paper_car"), of_bus | {"logging.directory": str(no_folder)})


def test_it_estimates_and_begins_a_log_as_soon_as_it_can(
    without: Config, connect: Callable[[], can.BusABC], drive: SimulatedDrive, no_folder: Path
) -> None:
    told: list[str] = []
    service = Service(without, [connect], plan_for(without), lambda is_error, text: told.append(text))
    service.prepare()
    summaries: list[Summary] = []
    thread = threading.Thread(target=lambda: summaries.append(service.run()), daemon=True)
    thread.start()
    assert service._log is not None
    with connect() as car:
        for i in range(400):
            car.send(message_from_frame(drive.frames, i))
        while service.received < 400:
            time.sleep(0.01)
        no_folder.unlink()  # the disk is mounted
        sent = 400
        while not service._log.counts.paths:  # tried again when something is to be logged
            car.send(message_from_frame(drive.frames, sent))
            sent += 1
            time.sleep(0.05)
    service.stop()
    thread.join()
    (summary,) = summaries
    assert any("trying a new log in" in line for line in told)
    assert any("estimating without a log" in line for line in told)
    assert any(line.startswith(f"logging to {no_folder}") for line in told)
    assert summary.frames == sent
    assert summary.estimates > 300
    assert not summary.complete
    assert summary.log is not None
    (path,) = summary.log.paths
    with open_log(path) as log:
        logged = sum(len(frames) for frames in log.frames())
    assert logged == summary.log.written > 0
    assert summary.log.written + summary.log.dropped == sent + summary.published
    assert summary.log.dropped >= 400


def test_a_log_that_nobody_named_is_not_needed(without: Config) -> None:
    process = LogProcess(plan_for(without), without.documents)
    process.open(needed=False)
    assert process.counts.paths == []
    (failure,) = process.counts.failures
    assert str(without.logging.directory) in failure
    process.close()


def test_a_slow_disk_is_told_and_not_waited_for(
    config: Config, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log_process, "SLOW_S", 0.0)
    process = LogProcess(plan_for(config, folder / "x.mcap"), config.documents)
    process.open(needed=False)
    assert "is slow" in process.news[0][1]
    while not process.counts.paths:
        process.pump()
        time.sleep(0.01)
    process.close()


def test_it_is_tried_less_and_less_often(without: Config, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_process, "RETRY_S", 0.01)
    monkeypatch.setattr(log_process, "LONGEST_RETRY_S", 0.04)
    pauses: list[float] = []
    monkeypatch.setattr(LogProcess, "_failed", watched(LogProcess._failed, pauses))
    process = LogProcess(plan_for(without), without.documents)
    process.open(needed=False)
    while len(pauses) < 4:
        if process.wants_new(time.monotonic()):
            process.rotate()
        process.pump()
        time.sleep(0.005)
    process.close()
    assert pauses[:4] == [0.01, 0.02, 0.04, 0.04]


def watched(failed: Callable[[LogProcess, str], None], pauses: list[float]) -> Callable[[LogProcess, str], None]:
    def note(process: LogProcess, reason: str) -> None:
        pauses.append(process._pause_s)
        failed(process, reason)

    return note


def test_nobody_waits_for_a_log_of_a_service_that_is_stopped(config: Config, folder: Path) -> None:
    process = LogProcess(plan_for(config, folder / "x.mcap"), config.documents)
    process.open(given_up=lambda: True)
    process.close()
    assert process.counts.failures == []


def test_a_log_writer_that_cannot_be_started_is_told_and_tried_again(
    config: Config, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No memory, or as many processes as there may be."""
    monkeypatch.setattr(log_process, "RESTART_S", 0.01)
    started = subprocess.Popen
    failures = iter([OSError(errno.EAGAIN, "Resource temporarily unavailable")] * 2)

    def start(*arguments: Any, **options: Any) -> object:
        if "dctorque_can.daemon.log.worker" in arguments[0] and (error := next(failures, None)):
            raise error
        return started(*arguments, **options)

    monkeypatch.setattr(log_process.subprocess, "Popen", start)
    process = LogProcess(plan_for(config, folder / "x.mcap"), config.documents)
    process.open(needed=False)
    process.hand_over(frames_message(Frames.empty(7)), 7)
    process.flush()
    while process.counts.written < 7:
        process.pump()
        time.sleep(0.01)
    told = [text for _, text in process.news]
    assert told[:2] == ["the log writer cannot be started: Resource temporarily unavailable"] * 2
    process.close()
    assert process.counts.dropped == 0
