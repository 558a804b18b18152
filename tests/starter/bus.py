"""Buses of invented cars: any name may carry anything that the simulation knows, or what only looks like it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.layout import SignalLayout
from dctorque_can.pipeline.frames import Frames
from dctorque_can.starter.databases import Dbc, read_dbc
from dctorque_can.starter.propose import propose
from dctorque_can.starter.recording import joined
from dctorque_can.starter.starter import Starter

Floats = NDArray[np.float64]
RPM = 30 / np.pi
RADIUS_M = 0.31
KM_H = 3.6 * RADIUS_M  # of a wheel's rad/s
PERIOD_US = 10_000


@dataclass(frozen=True)
class Drive:
    """A simulated drive, and how its car is seen from outside."""

    truth: NDArray[np.void]

    def __getattr__(self, name: str) -> Floats:
        return np.asarray(self.truth[name], np.float64)

    @property
    def wheel(self) -> Floats:
        return np.abs(self.undriven_wheel_speed_rad_s)

    @property
    def gear(self) -> Floats:
        """The gear of the clutch with the greater capacity; it stays while none has any."""
        first = self.clutch1_capacity_nm > self.clutch2_capacity_nm
        gear = np.where(first, self.gear1, self.gear2)
        open_ = np.maximum(self.clutch1_capacity_nm, self.clutch2_capacity_nm) <= 1.0
        rows = np.where(open_ | (gear == 0), 0, np.arange(len(gear)))
        return np.maximum(gear[np.maximum.accumulate(rows)], 1.0)

    @property
    def acceleration(self) -> Floats:
        return np.gradient(self.undriven_wheel_speed_rad_s, 1e-3) * RADIUS_M

    def later(self, values: Floats, seconds: float) -> Floats:
        """Return values as they were before, or will be with a negative time."""
        steps = round(1000 * seconds)
        rows = np.clip(np.arange(len(values)) - steps, 0, len(values) - 1)
        return np.asarray(values[rows], np.float64)


@dataclass(frozen=True)
class Signal:
    """One signal: ``Message.Name``, what it carries, and how."""

    name: str
    values: Callable[[Drive], NDArray[Any]]
    bits: int = 16
    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""
    table: str = ""
    comment: str = ""


def dbc_text(signals: Sequence[Signal]) -> str:
    """Return a DBC in which each message has its signals one behind the other, Intel order."""
    lines = ['VERSION ""', "NS_ :", "BS_:", "BU_: ECU", ""]
    after = []
    for number, message in enumerate(dict.fromkeys(each.name.split(".")[0] for each in signals)):
        lines.append(f"BO_ {0x100 + number} {message}: 64 ECU")
        start = 0
        for each in (each for each in signals if each.name.startswith(f"{message}.")):
            name = each.name.split(".")[1]
            lines.append(
                f' SG_ {name} : {start}|{each.bits}@1+ ({each.factor},{each.offset}) [0|0] "{each.unit}" ECU'
            )
            start += each.bits
            if each.table:
                after.append(f"VAL_ {0x100 + number} {name} {each.table} ;")
            if each.comment:
                after.append(f'CM_ SG_ {0x100 + number} {name} "{each.comment}";')
        lines.append("")
    return "\n".join([*lines, *after]) + "\n"


def frames_of(dbc: Dbc, signals: Sequence[Signal], drive: Drive, channel: int = 0) -> Frames:
    """Return frames of all messages, every 10 ms."""
    rows = np.arange(0, len(drive.truth), PERIOD_US // 1000)
    parts = []
    for number, message in enumerate(dbc.database.messages):
        frames = Frames.empty(len(rows), 64)
        frames.t_us[:] = drive.truth["t_us"][rows] + 1_700_000_000_000_000 + 130 * number
        frames.can_id[:], frames.length[:], frames.channel[:] = message.frame_id, message.length, channel
        frames.flags[:] = 1  # CAN FD
        for each in signals:
            if each.name.startswith(f"{message.name}."):
                layout = SignalLayout.of(message.get_signal_by_name(each.name.split(".")[1]))
                raw = np.round((each.values(drive)[rows] - each.offset) / each.factor)
                layout.write_raw(frames.data, np.clip(raw, 0, layout.mask).astype(np.uint64))
        parts.append(frames)
    return Frames.concatenate(parts).sorted_by_time()


def written(folder: Path, signals: Sequence[Signal], name: str = "car.dbc") -> Dbc:
    """Write the DBC, and read it."""
    path = folder / name
    path.write_text(dbc_text(signals), encoding="utf-8")
    return read_dbc(path)


def proposed(folder: Path, signals: Sequence[Signal], drive: Drive | None) -> Starter:
    """Return what is proposed of a bus, with a log of the drive or without one."""
    dbc = written(folder, signals)
    return propose([dbc], None if drive is None else joined([frames_of(dbc, signals, drive)]))


def levels(starter: Starter) -> dict[str, tuple[str, str]]:
    """Return key to (signal, level) of what was proposed."""
    return {each.key: (each.entry.signal.name, each.level) for each in starter.proposals}
