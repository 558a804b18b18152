"""Logs decoded by DBCs: every signal as a column, and on a common grid of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from cantools.database.can import Database
from numpy.typing import NDArray

from dctorque_can.bus.addresses import address_of
from dctorque_can.bus.columns import TIME, MessageColumns
from dctorque_can.pipeline.frames import Address, FrameFlag, Frames
from dctorque_can.starter.catalogue import Entry

Floats = NDArray[np.float64]
GRID_US = 20_000
_STALE_PERIODS, _STALE_US = 5.0, 500_000.0
_NO_INPUT = np.uint8(FrameFlag.REMOTE | FrameFlag.ERROR | FrameFlag.SENT)
_LONGEST_PAUSE_US, _LATEST_US = 2_000_000, 1_000_000
_GAP = 0.9  # of the largest raw value: a value that nothing comes near


@dataclass(frozen=True, slots=True)
class Period:
    """How often a message comes.

    Attributes:
        frames: of the recording.
        median_ms: half of the times between frames are less.
        longest_usual_ms: 99 of 100 are less.
    """

    frames: int
    median_ms: float
    longest_usual_ms: float


class Recording:
    """Frames of all logs, and the signals in them.

    Args:
        database: the messages of all DBCs.
        addresses: by what the frames of a message are known, by its name, where that is not its identifier.
        frames: of all logs, in order of time.

    Attributes:
        t_us: int64 ``[n]``, the grid: every 20 ms from the first frame to the last one.
    """

    def __init__(self, database: Database, addresses: Mapping[str, Address], frames: Frames) -> None:
        self._frames = frames[(frames.flags & _NO_INPUT) == 0]
        self._addresses = {m.name: address_of(m, addresses) for m in database.messages}
        self._columns = MessageColumns(database, addresses).decode(self._frames)
        first, last = (int(frames.t_us[0]), int(frames.t_us[-1])) if len(frames) else (0, 0)
        self.t_us = np.arange(first, last + 1, GRID_US, dtype=np.int64)
        self._on_grid: dict[tuple[str, str], Floats] = {}

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(self._frames)

    @property
    def seconds(self) -> float:
        """From the first frame to the last one."""
        return len(self.t_us) * GRID_US / 1e6

    @property
    def messages(self) -> frozenset[str]:
        """The messages that came, by name."""
        return frozenset(self._columns)

    def has(self, entry: Entry) -> bool:
        """Return whether the message of a signal came."""
        return entry.message.name in self._columns

    def frames_of(self, message: str) -> Frames:
        """Return the frames of a message."""
        return self._frames[self._addresses[message].rows(self._frames)]

    def channels(self, message: str) -> dict[int, int]:
        """Return on which channels a message came, and how often."""
        counts = np.bincount(self.frames_of(message).channel)
        return {int(channel): int(counts[channel]) for channel in np.flatnonzero(counts)}

    def samples(self, entry: Entry) -> tuple[NDArray[np.int64], Floats]:
        """Return times and physical values of a signal, both ``[n]``; values that mean none are left out."""
        rows = self._columns[entry.message.name]
        name = entry.signal.name if entry.signal.name != TIME else f"{TIME}_"
        values = rows[name]
        usable = np.isfinite(values)
        layout = entry.layout
        special = set(entry.no_value)
        top = layout.raw_range[1]
        if self.has_stray_top(entry):
            special.add(top)
        for raw in special:
            usable &= np.abs(values - (layout.scale * raw + layout.offset)) > 0.25 * abs(layout.scale)
        return rows[TIME][usable], values[usable]

    def has_stray_top(self, entry: Entry) -> bool:
        """Return whether all bits of a value are set now and then, far from any other value: "not available"."""
        layout = entry.layout
        if layout.is_float or layout.bits < 8:
            return False
        name = entry.signal.name if entry.signal.name != TIME else f"{TIME}_"
        raw = np.round((self._columns[entry.message.name][name] - layout.offset) / layout.scale)
        raw = raw[np.isfinite(raw)]
        top = float(layout.raw_range[1])
        others = raw[raw != top]
        return 0 < len(others) < len(raw) and float(others.max()) < _GAP * top

    def raw_values(self, entry: Entry) -> dict[int, int]:
        """Return each raw value of a signal that came, and how often; for signals of few values."""
        rows = self._columns[entry.message.name]
        name = entry.signal.name if entry.signal.name != TIME else f"{TIME}_"
        values = rows[name][np.isfinite(rows[name])]
        raw, counts = np.unique(np.round((values - entry.layout.offset) / entry.layout.scale), return_counts=True)
        return {int(each): int(count) for each, count in zip(raw, counts, strict=True)}

    def on_grid(self, entry: Entry) -> Floats:
        """Return the latest value at each time of the grid, float64 ``[n]``; NaN where it is old or missing."""
        key = (entry.message.name, entry.signal.name)
        if key not in self._on_grid:
            t_us, values = self.samples(entry)
            self._on_grid[key] = self._held(t_us, values)
        return self._on_grid[key]

    def _held(self, t_us: NDArray[np.int64], values: Floats) -> Floats:
        if not len(t_us):
            return np.full(len(self.t_us), np.nan)
        latest = np.searchsorted(t_us, self.t_us, side="right") - 1
        held = values[np.maximum(latest, 0)]
        usual = float(np.median(np.diff(t_us))) if len(t_us) > 1 else 0.0
        oldest = max(_STALE_PERIODS * usual, _STALE_US)
        old = self.t_us - t_us[np.maximum(latest, 0)] > oldest
        return np.where((latest < 0) | old, np.nan, held)

    def is_constant(self, entry: Entry) -> bool:
        """Return whether a signal never changed."""
        _, values = self.samples(entry)
        return not len(values) or bool((values == values[0]).all())

    def period(self, message: str) -> Period | None:
        """Return how often a message came; None of one that did not come twice."""
        if message not in self._columns:
            return None
        t_us = self._columns[message][TIME]
        steps = np.diff(t_us)
        steps = steps[steps >= 0]
        if not len(steps):
            return None
        median, usual = np.percentile(steps / 1000.0, [50, 99])
        return Period(len(t_us), round(float(median), 1), round(float(usual), 1))


def joined(parts: Sequence[Frames]) -> Frames:
    """Return the frames of several logs one after another, on one scale of time.

    Frames that are late by less than a second are sorted. Longer pauses, between logs or in one of them, become
    2 s. A clock that was set back goes on.
    """
    ordered = [_without_late_ones(part) for part in parts if len(part)]
    if not ordered:
        return Frames.empty()
    frames = Frames.concatenate(ordered)
    steps = np.diff(frames.t_us, prepend=frames.t_us[0])
    steps[(steps < 0) | (steps > _LONGEST_PAUSE_US)] = _LONGEST_PAUSE_US
    return replace(frames, t_us=frames.t_us[0] + np.cumsum(steps))


def _without_late_ones(frames: Frames) -> Frames:
    behind = np.maximum.accumulate(frames.t_us) - frames.t_us
    return frames.sorted_by_time() if 0 < behind.max() < _LATEST_US else frames
