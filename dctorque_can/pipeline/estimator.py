"""The estimator: samples in, estimates and health out. The same for live frames, logs and tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import entry
from dctorque_can.driveline.gear_pair import singular_pairs
from dctorque_can.driveline.parameters import MAX_GEAR, Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline import bounds, core, delays, methods, parts
from dctorque_can.pipeline.estimates import ESTIMATE, HEALTH, Estimates
from dctorque_can.pipeline.rules import rules
from dctorque_can.pipeline.samples import N_QUANTITIES, Samples
from dctorque_can.pipeline.settings import Settings

FEW = 256  # samples, for which there is always room: a live batch
NO_SAMPLES = Samples.zeros(0)
NO_ROWS = np.zeros(0, ESTIMATE)
NO_HEALTH = np.zeros(0, HEALTH)
NOTHING = Estimates(NO_ROWS, NO_HEALTH)
BY_PERIOD = np.zeros(0, np.bool_)


class Moment(NamedTuple):
    """All that changes in an estimator while it is fed, but for a tape.

    Attributes:
        memory: of `Parts`.
        waiting: `delays.SAMPLES` ``[n]`` that have not taken effect, the oldest first.
        stale: inputs that were missing in the last estimate ``[N_QUANTITIES]``.
        frame_us: time of the last frame.
        frame: its number.
    """

    memory: NDArray[np.int64]
    waiting: NDArray[np.void]
    stale: NDArray[np.uint8]
    frame_us: int
    frame: int


class Estimator:
    """Estimates both clutch torques from samples; its state depends on the samples alone.

    Feeding a log at once, frame by frame or cut anywhere gives the same bits.

    Args:
        settings: vehicle, inputs and design.
        chosen: another estimator than the one of ``settings.method``, as `estimators.contract` has it.

    Raises:
        DctorqueError: two gears of different shafts have the same total ratio, or a gear number is too large.

    Attributes:
        inbox: room for `FEW` samples, for `feed_inbox`.
    """

    def __init__(self, settings: Settings, chosen: Any = None) -> None:
        _refuse_singular_pairs(settings.vehicle)
        if chosen is None:
            chosen = methods.new(settings)
        self._rules = rules(settings)
        self._now = parts.new(chosen, settings, self._rules["coolant"][0])
        self._ahead = parts.new(chosen, settings, self._rules["coolant"][0])
        self._queue = delays.new()
        self.inbox = Samples.zeros(FEW)
        rows, health = np.zeros(FEW, ESTIMATE), np.zeros(FEW, HEALTH)
        self._row_bytes, self._health_bytes = rows.view(np.uint8).data, health.view(np.uint8).data
        self._small = self._arguments(self.inbox, BY_PERIOD, False, rows, health)
        self._run_small: Callable[..., tuple[int, int]] | None = None

    def feed(self, samples: Samples, wanted: NDArray[np.bool_] = BY_PERIOD) -> Estimates:
        """Take samples in order of arrival and return the estimates that became due.

        Args:
            samples: any number of them.
            wanted: bool ``[n]``, after which samples an estimate is wanted; empty: as they become due.
        """
        if len(samples) <= FEW and not len(wanted):
            n, inbox = len(samples), self.inbox
            inbox.t_us[:n], inbox.quantity[:n], inbox.value[:n] = samples.t_us, samples.quantity, samples.value
            inbox.status[:n], inbox.last[:n] = samples.status, samples.last
            return self.feed_inbox(n)
        rows = np.zeros(int(np.count_nonzero(wanted if len(wanted) else samples.last)), ESTIMATE)
        # untouched rows cost no memory
        health = np.zeros(int(np.count_nonzero(samples.last)), HEALTH)
        n_rows, n_health = core.run(len(samples), *self._arguments(samples, wanted, False, rows, health))
        return Estimates(rows[:n_rows], health[:n_health].copy() if n_health else NO_HEALTH)

    def feed_inbox(self, n: int) -> Estimates:
        """Take the first n samples of the `inbox` as `feed` does: what came live since the last time.

        Raises:
            ValueError: the inbox has no n samples.
        """
        if not 0 <= n <= FEW:
            raise ValueError(f"the inbox has {FEW} samples, not {n}")
        if self._run_small is None:
            self._run_small = entry(core.run, (n, *self._small))
        n_rows, n_health = self._run_small(n, *self._small)
        if not n_rows and not n_health:
            return NOTHING
        return Estimates(
            _copied(self._row_bytes, n_rows, ESTIMATE) if n_rows else NO_ROWS,
            _copied(self._health_bytes, n_health, HEALTH) if n_health else NO_HEALTH,
        )

    def _arguments(
        self,
        samples: Samples,
        wanted: NDArray[np.bool_],
        asked: bool,
        rows: NDArray[np.void],
        health: NDArray[np.void],
    ) -> tuple[Any, ...]:
        """Return the arguments of `core.run` after the first."""
        columns = samples.t_us, samples.quantity, samples.value, samples.status, samples.last
        return *columns, wanted, asked, self._rules, self._now, self._ahead, self._queue, rows, health

    @property
    def chosen(self) -> Any:
        """The estimator itself, as `estimators.contract` has it."""
        return self._now.chosen

    @property
    def diary(self) -> NDArray[np.void]:
        """`hindsight.DIARY` ``[1]``: which way the car went, and will go."""
        found: NDArray[np.void] = self._now.core["direction"]["diary"]
        return found

    @property
    def dtypes(self) -> tuple[np.dtype[np.void], ...]:
        """Of the records in the memory that a `snapshot` holds."""
        return parts.dtypes(self._now)

    @property
    def torque_limits(self) -> NDArray[np.float64]:
        """Largest clutch torques and output torque that are published ``[3]``, N·m."""
        inputs = self._now.inputs[0]
        return np.append(inputs["torque_limit"], inputs["output_limit"])

    def snapshot(self) -> Moment:
        """Return a copy of all that changes in `feed`, but for the estimator's tape."""
        queue = self._queue[0]
        places = (queue["first"] + np.arange(queue["count"])) % delays.PLACES
        waiting, stale = queue["waiting"][places], queue["stale"].copy()
        return Moment(self._now.memory.copy(), waiting, stale, int(queue["frame_us"]), int(queue["frame"]))

    def restore(self, snapshot: Moment) -> None:
        """Go back to a `snapshot` of this estimator; the tape stays."""
        self._now.memory[:] = snapshot.memory
        queue, count = self._queue[0], len(snapshot.waiting)
        queue["first"], queue["count"] = 0, count
        queue["frame_us"], queue["frame"] = snapshot.frame_us, snapshot.frame
        queue["waiting"][:count], queue["stale"] = snapshot.waiting, snapshot.stale

    def problem(self, snapshot: Moment) -> str:
        """Return why a snapshot that is not of this process may not be restored, "" if it may."""
        memory, waiting, stale, frame_us, frame = snapshot
        rules = self._rules[0]
        if memory.shape != self._now.memory.shape or stale.shape != (N_QUANTITIES,) or len(waiting) > delays.MOST:
            return "it is of another shape"
        if (stale > 1).any() or abs(frame_us) > core.LATEST_US or not 0 <= frame < core.LATEST_US:
            return "what is noted of the last frame is none"
        if self._now.memory.dtype != memory.dtype or waiting.dtype != delays.SAMPLES or stale.dtype != np.uint8:
            return "it is of another type"
        self._ahead.memory[:] = memory  # which every look ahead begins with
        wrong = bounds.problem(self._ahead, self._now, rules)
        return wrong or bounds.waiting_problem(waiting, int(self._ahead.core["arrived_us"][0]), rules)

    @property
    def health(self) -> NDArray[np.void]:
        """`HEALTH` ``[1]``: the counters at the time of the last frame."""
        row = np.zeros(1, HEALTH)
        core.run(0, *self._arguments(NO_SAMPLES, BY_PERIOD, True, NO_ROWS, row))
        return row


def warm_up(settings: Settings) -> None:
    """Compile everything that `Estimator.feed` needs, so that the first frame is as fast as the others."""
    quantities = np.arange(N_QUANTITIES, dtype=np.uint8)
    n = len(quantities)
    Estimator(settings).feed(
        Samples(np.zeros(n, np.int64), quantities, np.zeros(n), np.zeros(n, np.uint8), np.arange(n) == n - 1)
    )


def _copied(rows: memoryview, n: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Return a copy of the first n rows, at once instead of field by field as numpy would."""
    return np.frombuffer(bytearray(rows[: n * dtype.itemsize]), dtype)


def _refuse_singular_pairs(vehicle: Vehicle) -> None:
    """Raise if some pair of gears cannot be told apart by (65), (66)."""
    wrong = [
        f"gear {g.number} (shaft {g.shaft}): numbers go up to {MAX_GEAR}"
        for g in vehicle.gears
        if not -1 <= g.number <= MAX_GEAR or g.number == 0
    ]
    wrong += singular_pairs(vehicle)
    if wrong:
        raise DctorqueError("vehicle: " + "; ".join(wrong))
