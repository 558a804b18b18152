"""An hour of traffic, or as much as is asked for: one drive of a production car, repeated with shifted times."""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

import numpy as np
from commit_environment import progress

from dctorque_can import __version__
from dctorque_can.config.load import Config
from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.pipeline.frames import Frames
from dctorque_can.simulation.drive import mixed_drive, simulate
from dctorque_can.simulation.sensors import PRODUCTION, emit_frames

BLOCK_US = 300_000  # all counters (0..14, every 10 or 20 ms) are back where they were
DRIVE_S = 240.0
SEED = 7
START_US = 1_700_000_000_000_000
MINUTE_US = 60_000_000


def drive_frames(config: Config) -> Frames:
    """Return one drive, cut to whole rounds of every counter."""
    progress("simulating the drive")
    vehicle = config.settings.vehicle
    truth = simulate(vehicle, mixed_drive(vehicle, SEED, DRIVE_S))
    frames = emit_frames(truth, vehicle, PRODUCTION, config.database, start_us=START_US)
    blocks = int(frames.t_us[-1] - frames.t_us[0]) // BLOCK_US - 1
    keep = np.zeros(len(frames), bool)
    for can_id in np.unique(frames.can_id):
        rows = np.flatnonzero(frames.can_id == can_id)
        period_us = round(float(np.median(np.diff(frames.t_us[rows]))), -3)
        keep[rows[: blocks * round(BLOCK_US / period_us)]] = True
    return frames[keep]


def long_frames(config: Config, minutes: float) -> Frames:
    """Return the drive again and again, as one recording of ``minutes``."""
    one = drive_frames(config)
    step_us = -(-int(one.t_us[-1] - one.t_us[0]) // BLOCK_US) * BLOCK_US
    times = int(-(-minutes * MINUTE_US // step_us))
    shifts = np.repeat(np.arange(times) * step_us, len(one))
    everything = Frames.concatenate([one] * times)
    everything.t_us[:] += shifts
    ordered = everything.sorted_by_time()
    return ordered[ordered.t_us < ordered.t_us[0] + round(minutes * MINUTE_US)]


def make_logs(config: Config, minutes: float, formats: list[str]) -> tuple[dict[str, Path], Frames]:
    """Return the logs by format, made now or the last time."""
    frames = long_frames(config, minutes)
    key = hashlib.sha256(frames.t_us.tobytes() + frames.data.tobytes() + __version__.encode()).hexdigest()[:12]
    folder = Path(tempfile.gettempdir()) / f"dctorque-bench-{os.getuid()}" / key
    folder.mkdir(parents=True, exist_ok=True)
    logs = {}
    for suffix in formats:
        logs[suffix] = folder / f"drive.{suffix}"
        if logs[suffix].exists():
            continue
        progress(f"writing {logs[suffix]}")
        part = folder / f"part.{suffix}"
        if suffix == "mcap":
            with McapLog(part, documents=config.documents) as log:
                log.write_frames(frames)
        else:
            write_frames(part, frames)
        part.rename(logs[suffix])
    return logs, frames
