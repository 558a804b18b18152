"""The frames of a bus at full load, half of a simulated car, half numbered; and what disturbs them."""

from __future__ import annotations

from dataclasses import astuple, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dctorque_can.config.load import Config
from dctorque_can.simulation.drive import mixed_drive, simulate
from dctorque_can.simulation.sensors import PRODUCTION, Timing, emit_frames

RECORD = np.dtype([("t_us", "<i8"), ("can_id", "<u4"), ("length", "u1"), ("spare", "u1", 3), ("data", "u1", 8)])
"""A frame, as `soak_bus.RECORD` has it."""
NUMBERED = 0x400
"""Identifiers from here on, `NUMBERED_IDS` of them, have their own number as data."""
NUMBERED_IDS = 32
PRODUCTION_HZ = 400
DRIVE_S = 180.0


@dataclass
class Disturbance:
    """What happens to frames on their way, until it is set otherwise.

    Attributes:
        loss: share of the car's frames that are not sent.
        duplication: share that is sent twice.
        reordering: share that comes later than what follows.
        flips: share with one bit changed.
        flood: identifiers, one of which is drawn for each frame of a flood.
        flood_hz: frames of the flood per second.
        burst_s: all frames of so long are sent at once.
        silent: nothing is sent.
        clock_us: by so much the clock is off.
    """

    loss: float = 0.0
    duplication: float = 0.0
    reordering: float = 0.0
    flips: float = 0.0
    flood: tuple[int, ...] = ()
    flood_hz: float = 0.0
    burst_s: float = 0.0
    silent: bool = False
    clock_us: int = 0


def drive_records(config: Config, rate_hz: float, seed: int) -> NDArray[np.void]:
    """Return one drive of the simulated car with the messages of a production bus, so many frames per second."""
    slower = PRODUCTION_HZ / rate_hz
    timing = {
        name: Timing(*(round(us * slower) for us in astuple(each))) for name, each in PRODUCTION.timing.items()
    }
    vehicle = config.settings.vehicle
    truth = simulate(vehicle, mixed_drive(vehicle, seed, DRIVE_S))
    frames = emit_frames(truth, vehicle, replace(PRODUCTION, timing=timing), config.database)
    records = np.zeros(len(frames), RECORD)
    records["t_us"] = frames.t_us - frames.t_us[0]
    records["can_id"], records["length"], records["data"] = frames.can_id, frames.length, frames.data[:, :8]
    return records


class Traffic:
    """Gives what is due; the same calls give the same frames.

    Args:
        drive: of the car, repeated for ever.
        rate_hz: of all frames together.
        seed: of what is left to chance.
    """

    def __init__(self, drive: NDArray[np.void], rate_hz: float, seed: int) -> None:
        self.disturbance = Disturbance()
        self._drive = drive
        self._round_us = int(drive["t_us"][-1]) + 1000
        self._step_us = 2e6 / rate_hz
        self._chance = np.random.default_rng(seed)
        self._until_us = 0
        self._at = 0
        self._due_numbers = 0
        self._number = 0
        self._late = drive[:0]
        self._kept: list[NDArray[np.void]] = []
        self._burst_us = 0
        self._flood_until_us = 0

    def due(self, now_us: int) -> NDArray[np.void]:
        """Return the records due up to a time since the start; their times are those at which they were."""
        now = self.disturbance
        car, until_us = self._of_the_car(now_us), self._until_us
        numbered = self._numbered(now_us)
        self._until_us = now_us
        if now.silent:
            return self._drive[:0]
        parts = [self._late, self._disturbed(car, now), numbered, self._flood(until_us, now_us, now)]
        self._late = self._late[:0]
        if now.reordering and len(parts[1]):
            late = self._chance.random(len(parts[1])) < now.reordering
            self._late = parts[1][late]
            parts[1] = parts[1][~late]
        records = np.concatenate(parts)
        records = records[np.argsort(records["t_us"], kind="stable")] if not now.reordering else records
        self._kept.append(records)
        if now.burst_s and now_us < self._burst_us + 1e6 * now.burst_s:
            return self._drive[:0]
        self._burst_us = now_us
        return self._released(now_us, bool(now.burst_s), now.clock_us)

    def _released(self, now_us: int, together: bool, clock_us: int) -> NDArray[np.void]:
        records = np.concatenate(self._kept)
        self._kept.clear()
        if together:
            records["t_us"] = now_us - 10 * np.arange(len(records))[::-1]
        records["t_us"] += clock_us
        ours = np.flatnonzero(records["length"] == 0)  # to be numbered as they leave
        numbers = self._number + np.arange(len(ours))
        self._number += len(ours)
        records["length"][ours] = 8
        records["can_id"][ours] = NUMBERED + numbers % NUMBERED_IDS
        records["data"][ours] = numbers.astype("<u8").view("u1").reshape(-1, 8)
        return records

    def _of_the_car(self, now_us: int) -> NDArray[np.void]:
        parts = []
        while True:
            round_us, n = divmod(self._at, len(self._drive))
            shift_us = round_us * self._round_us
            end = int(np.searchsorted(self._drive["t_us"], now_us - shift_us, "right"))
            part = self._drive[n:end].copy()
            part["t_us"] += shift_us
            parts.append(part)
            self._at += len(part)
            if end < len(self._drive):
                return np.concatenate(parts)

    def _numbered(self, now_us: int) -> NDArray[np.void]:
        count = int(now_us / self._step_us) - self._due_numbers
        records = np.zeros(max(count, 0), RECORD)
        records["t_us"] = (self._step_us * (self._due_numbers + 1 + np.arange(len(records)))).astype(np.int64)
        self._due_numbers += len(records)
        return records

    def _disturbed(self, car: NDArray[np.void], now: Disturbance) -> NDArray[np.void]:
        if now.loss:
            car = car[self._chance.random(len(car)) >= now.loss]
        if now.duplication:
            car = np.repeat(car, 1 + (self._chance.random(len(car)) < now.duplication))
        if now.flips:
            for i in np.flatnonzero(self._chance.random(len(car)) < now.flips):
                bit = int(self._chance.integers(64))
                car["data"][i, bit // 8] ^= 1 << bit % 8
        return car

    def _flood(self, until_us: int, now_us: int, now: Disturbance) -> NDArray[np.void]:
        if not now.flood:
            return self._drive[:0]
        records = np.zeros(self._chance.poisson(now.flood_hz * (now_us - until_us) / 1e6), RECORD)
        records["t_us"], records["length"] = now_us, 8
        records["can_id"] = self._chance.choice(now.flood, len(records))
        records["data"] = self._chance.integers(0, 256, (len(records), 8))
        return records
