"""A recording as time series of what it measures: each mapped quantity in SI, as the estimator would take it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config
from dctorque_can.driveline.phase_decision import closing_band
from dctorque_can.driveline.phases import PhaseSource
from dctorque_can.logs.reader import LogReader
from dctorque_can.logs.reorder import Reorder
from dctorque_can.offline.replay import reorder_window_us
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.samples import N_QUANTITIES, Quantity, SampleStatus

Floats = NDArray[np.float64]
UNKNOWN_GEAR = -2
"""Of `Series.gears`, where no gear is told; -1 is reverse, 0 neutral."""
_WIDEST = 1e15
_PATIENCE = 1_000_000  # µs; a gear or a flag counts for so long at least


@dataclass(frozen=True, slots=True)
class Signal:
    """The usable samples of one quantity, in order of arrival.

    Attributes:
        t_s: times of their frames ``[n]``, s since the first mapped frame of the recording; does not fall.
        value: ``[n]``, SI as `Quantity` says; finite.
    """

    t_s: Floats
    value: Floats

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def period_s(self) -> float:
        """Median time between two samples, s; 0 where there are fewer than two."""
        return float(np.median(np.diff(self.t_s))) if len(self) > 1 else 0.0

    def sooner(self, delay_s: float) -> Signal:
        """Return the samples at the times at which they were taken, if their frames are late by ``delay_s``."""
        return replace(self, t_s=self.t_s - delay_s)

    def at(self, t_s: Floats, longest_s: float) -> Floats:
        """Return the value between samples at times ``[m]``, by straight lines.

        Args:
            t_s: times, s.
            longest_s: not-a-number where the samples before and after are further apart.
        """
        if len(self) < 2:
            return np.full(len(t_s), np.nan)
        found = np.interp(t_s, self.t_s, self.value, left=np.nan, right=np.nan)
        after = np.clip(np.searchsorted(self.t_s, t_s, side="left"), 1, len(self) - 1)
        found[self.t_s[after] - self.t_s[after - 1] > longest_s] = np.nan
        return np.asarray(found, np.float64)

    def held(self, t_s: Floats, longest_s: float) -> Floats:
        """Return the last value at times ``[m]``; not-a-number before the first one and where it is older."""
        if not len(self):
            return np.full(len(t_s), np.nan)
        before = np.searchsorted(self.t_s, t_s, side="right") - 1
        found = self.value[np.maximum(before, 0)].copy()
        found[(before < 0) | (t_s - self.t_s[np.maximum(before, 0)] > longest_s)] = np.nan
        return found


@dataclass(frozen=True, slots=True)
class Series:
    """All that a recording measures.

    Attributes:
        signals: by quantity; one that is not mapped, or of which nothing usable came, is missing.
        seconds: from the first mapped frame to the last.
        config: by which they were read.
    """

    signals: Mapping[Quantity, Signal]
    seconds: float
    config: Config

    def taken(self, quantity: Quantity) -> Signal:
        """Return the samples of a quantity at the times at which they were taken, as the file tells its delay.

        Raises:
            KeyError: there are none.
        """
        delay_us = next(each.delay_us for each in self.config.inputs if each.quantity is quantity)
        return self.signals[quantity].sooner(1e-6 * delay_us)

    def on(self, quantity: Quantity, t_s: Floats) -> Floats:
        """Return a measured value at times ``[m]`` (as taken); not-a-number where it is not known."""
        if quantity not in self.signals:
            return np.full(len(t_s), np.nan)
        signal = self.taken(quantity)
        return signal.at(t_s, max(4.0 * signal.period_s, 0.05))

    def told(self, quantity: Quantity, t_s: Floats) -> Floats:
        """Return what was told last (a gear, a flag) at times ``[m]``; not-a-number where it is not known."""
        if quantity not in self.signals:
            return np.full(len(t_s), np.nan)
        given = next(each for each in self.config.inputs if each.quantity is quantity)
        return self.taken(quantity).held(t_s, 1e-6 * max(given.timeout_us, _PATIENCE))

    def gears(self, shaft: int, t_s: Floats) -> NDArray[np.int64]:
        """Return the gear that is told of a shaft at times ``[m]``.

        With one signal for the whole gearbox only that shaft's gear is told which drives.

        Args:
            shaft: 1 or 2.
            t_s: times, s.

        Returns:
            Its number, -1 for reverse, 0 for neutral, `UNKNOWN_GEAR` where nothing is told.
        """
        if Quantity.GEAR in self.signals:
            told = self.told(Quantity.GEAR, t_s)
            mine = [gear.number for gear in self.config.settings.vehicle.gears_on(shaft)]
            told[~np.isin(told, [0.0, *map(float, mine)])] = np.nan
        else:
            told = self.told(Quantity(Quantity.GEAR1 + shaft - 1), t_s)
        return np.where(np.isnan(told), UNKNOWN_GEAR, told).astype(np.int64)

    def closes_by(self, clutch: int, t_s: Floats) -> Floats:
        """Return by how much a clutch is told to be beyond the point where it closes, at times ``[m]``.

        Positive: it can carry torque. In the unit of the position or of the command; +1 and -1 of a flag and of a
        state. Not-a-number where nothing is told.

        Args:
            clutch: 1 or 2.
            t_s: times, s.
        """
        actuation = self.config.settings.phases.clutches[clutch - 1]
        match actuation.source:
            case PhaseSource.POSITION | PhaseSource.COMMAND:
                first = (
                    Quantity.CLUTCH1_POSITION
                    if actuation.source is PhaseSource.POSITION
                    else Quantity.CLUTCH1_COMMAND
                )
                sign = closing_band(actuation)[0]
                return sign * (self.on(Quantity(first + clutch - 1), t_s) - actuation.threshold)
            case PhaseSource.FLAG:
                return 1.0 - 2.0 * self.told(Quantity(Quantity.CLUTCH1_OPEN + clutch - 1), t_s)
            case PhaseSource.STATE:
                return np.sign(self.told(Quantity.CLUTCH_STATE, t_s) - 0.5)
            case _:
                return np.full(len(t_s), np.nan)


def read_frames(
    logs: Sequence[LogReader], config: Config, progress: Callable[[float], None] = lambda fraction: None
) -> list[Frames]:
    """Return the frames of ``logs``, one after another, each sorted as a replay would.

    Raises:
        DctorqueError: a log cannot be read.
    """
    frames = []
    for number, reader in enumerate(logs):
        for batch in Reorder(reorder_window_us(reader, config)).sorted(reader.dated_frames()):
            frames.append(batch)
            progress((number + reader.fraction) / len(logs))
    return frames


def decoded(frames: Iterable[Frames], config: Config, any_value: bool = False) -> Series:
    """Return what frames say of each quantity that ``config`` maps.

    Where the clock steps back, what follows is moved so that time goes on.

    Args:
        frames: in order.
        config: of the car.
        any_value: also values beyond the plausible range of the input.
    """
    inputs = config.inputs
    if any_value:
        inputs = tuple(replace(each, minimum=-_WIDEST, maximum=_WIDEST) for each in inputs)
    decoder = Decoder(config.database, inputs, config.protections, config.addresses)
    batches = [samples for samples in map(decoder.decode, frames) if len(samples)]
    if not batches:
        return Series({}, 0.0, config)
    t_us = np.concatenate([samples.t_us for samples in batches])
    t_s = 1e-6 * np.cumsum(np.maximum(np.diff(t_us, prepend=t_us[0]), 0))
    quantity = np.concatenate([samples.quantity for samples in batches])
    value = np.concatenate([samples.value for samples in batches])
    usable = np.concatenate([samples.status for samples in batches]) == SampleStatus.OK
    signals = {}
    for number in range(N_QUANTITIES):
        rows = np.flatnonzero(usable & (quantity == number))
        if len(rows):
            signals[Quantity(number)] = Signal(t_s[rows], value[rows])
    return Series(signals, float(t_s[-1]), config)
