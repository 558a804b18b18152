"""A whole recording with known delays in the order in which its samples were taken: what `delays` does online."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.samples import Quantity, Samples, SampleStatus
from dctorque_can.pipeline.settings import Settings

_TIME_ALONE = int(SampleStatus.NOT_AVAILABLE)  # its frame is sound, so its time counts


class Arrivals:
    """Keeps samples as they arrive, and where estimates became due; gives them back in order.

    Args:
        settings: inputs with their delays.
    """

    def __init__(self, settings: Settings) -> None:
        self._delay_us = np.zeros(len(Quantity), np.int64)
        for item in settings.inputs:
            self._delay_us[item.quantity] = item.delay_us
        self._max_step_back_us = settings.max_step_back_us
        self._latest_us: int | None = None
        self._stretches: list[list[tuple[Samples, bool]]] = []  # the flag: these are only times of estimates

    def split(self, samples: Samples) -> Iterator[Samples]:
        """Yield ``samples`` in parts, so that each step back of the clock begins a new one."""
        first = 0
        for n, t_us in enumerate(samples.t_us.tolist()):
            if self._latest_us is None or t_us < self._latest_us - self._max_step_back_us:
                yield from (samples[first:n],) if n > first else ()
                self._stretches.append([])
                first, self._latest_us = n, t_us
            self._latest_us = max(self._latest_us, t_us)
        yield samples[first:]

    def add(self, samples: Samples, due_us: NDArray[np.int64]) -> None:
        """Keep samples of one `split` and the times of the estimates that became due in them."""
        n = len(due_us)
        times = Samples(
            due_us.copy(),
            np.full(n, Quantity.ENGINE_SPEED, np.uint8),
            np.zeros(n),
            np.full(n, _TIME_ALONE, np.uint8),
            np.ones(n, np.bool_),
        )
        self._stretches[-1] += [(samples, False), (times, True)]

    def in_order(self) -> Iterator[tuple[Samples, NDArray[np.bool_]]]:
        """Yield samples at the times at which they were taken, and after which of them an estimate is wanted."""
        for stretch in self._stretches:
            parts = [samples for samples, _ in stretch]
            t_us, quantity, value, status, last = (
                np.concatenate([getattr(part, name) for part in parts]) for name in Samples.__slots__
            )
            wanted = np.concatenate([np.full(len(samples), is_due) for samples, is_due in stretch])
            ends = last & ~wanted
            frame = np.where(wanted, -1, np.cumsum(ends) - ends)  # number of the frame, from 0
            t_us = np.where(wanted, t_us, t_us - self._delay_us[quantity])
            order = np.lexsort((wanted, t_us))  # stable: else as they arrived
            t_us, frame = t_us[order], frame[order]
            last = np.append((np.diff(t_us) != 0) | (np.diff(frame) != 0), np.ones(min(len(t_us), 1), np.bool_))
            yield Samples(t_us, quantity[order], value[order], status[order], last), wanted[order]


def without_delays(settings: Settings) -> Settings:
    """Return settings for samples at the times at which they were taken; nothing is missing sooner than before."""
    longest = max((item.delay_us for item in settings.inputs), default=0)
    inputs = [replace(i, delay_us=0, timeout_us=i.timeout_us + i.delay_us) for i in settings.inputs]
    return replace(settings, inputs=tuple(inputs), max_gap_us=settings.max_gap_us + longest)
