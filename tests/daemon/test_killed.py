"""`kill -9` of the service, and of all its processes: what is left is closed and replays to the same bits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dctorque_can.chain import Chain
from dctorque_can.config.load import load_config
from dctorque_can.daemon.log.plan import STATE_NAME, plan_for
from dctorque_can.daemon.log.recovery import finalise_all
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config

from .victim import NUMBERED

END = b"\x89MCAP0\r\n"


@pytest.fixture
def victim(tmp_path: Path, folder: Path, drive: SimulatedDrive) -> Iterator[subprocess.Popen[str]]:
    """A service that has begun its third log."""
    frames = drive.frames
    columns = {name: getattr(frames, name) for name in ("t_us", "can_id", "length", "flags", "channel", "data")}
    np.savez(tmp_path / "drive.npz", **columns)
    words = [shipped_config("paper_car"), tmp_path / "drive.npz", folder, tmp_path / "received"]
    process = subprocess.Popen(
        [sys.executable, Path(__file__).with_name("victim.py"), *words, "logging.rotate_mb=0.15"],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    told: list[str] = []
    while len([line for line in told if line.startswith("logging to")]) < 3:
        line = process.stderr.readline()
        assert line, told
        told.append(line)
    yield process
    process.kill()
    process.communicate()


def log_writers(pid: int) -> list[int]:
    """Return the log processes of a service."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == pid and "daemon.log.worker" in (entry / "cmdline").read_text():
                found.append(int(entry.name))
        except OSError:  # it has ended meanwhile
            continue
    return found


def replays_alone(path: Path) -> list[int]:
    """Replay a log against its own estimates, and return the numbers of its numbered frames."""
    chain = Chain(load_config(shipped_config("paper_car")))
    with open_log(path) as log:
        frames = Frames.concatenate(log.frames())
        assert log.problems == []
        if STATE_NAME in log.documents:
            assert chain.restore(log.documents[STATE_NAME]) == ""
    logged, replayed = read_table(path, ESTIMATES), chain.feed(frames).rows
    assert (
        logged.tobytes() == replayed[: len(logged)].tobytes()
    )  # the last ones may be lost, but never a frame before
    own = frames.data[frames.can_id == NUMBERED][:, :8].copy()
    return own.view("<u8").ravel().tolist()


def test_a_killed_service_leaves_closed_logs_with_all_that_was_handed_over(
    victim: subprocess.Popen[str], folder: Path, tmp_path: Path
) -> None:
    """The log process ends with one line, and of what the service had received at most 50 ms are missing."""
    assert len(log_writers(victim.pid)) == 1
    os.kill(victim.pid, signal.SIGKILL)
    victim.wait()
    assert victim.stderr is not None
    lines = victim.stderr.read().splitlines()  # ends when the log process does
    last = [line for line in lines if not line.startswith("logging to")]
    assert len(last) == 1
    assert last[0].startswith("dctorque: the service is gone; all that it handed over is in ")
    numbers = []
    for path in sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns):
        assert path.read_bytes().endswith(END)
        numbers += replays_alone(path)
    assert numbers == list(range(1, len(numbers) + 1))
    received = int(np.fromfile(tmp_path / "received", "<u8")[0])
    assert received - len(numbers) < 200  # of the machine's load, too: a numbered frame comes every 5 ms


def test_when_all_is_killed_the_next_start_closes_what_is_torn(
    victim: subprocess.Popen[str], folder: Path
) -> None:
    writers = log_writers(victim.pid)
    os.kill(victim.pid, signal.SIGSTOP)  # so that it does not begin another one
    for pid in (*writers, victim.pid):
        os.kill(pid, signal.SIGKILL)
    victim.wait()
    config = load_config(shipped_config("paper_car"), {"logging.directory": str(folder)})
    told = list(finalise_all(plan_for(config).folder, {}, patience_s=600.0))
    assert not any(is_error for _, is_error, _ in told)
    numbers = []
    for log in plan_for(config).folder.own_logs():
        assert log.path.read_bytes().endswith(END)
        numbers += replays_alone(log.path)
    assert numbers == list(range(1, len(numbers) + 1))
