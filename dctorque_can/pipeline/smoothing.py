"""A whole recording smoothed: forwards in segments, and back over them from the last to the first.

Going forwards keeps the samples and the estimates. A second time forwards it is known which way the car goes
(`hindsight`), and the filter's tape tells what errors that last do to the estimates (`estimators.kalman.lasting`);
of each segment a snapshot is kept. Going back runs a segment once more from its snapshot, and the smoother
(`estimators.kalman.smoother`) follows the tape. So only one segment at a time has a tape, and nothing depends on
how long a segment is.

Samples that come late by a known delay are first put in the order in which they were taken (`arrivals`): a whole
recording needs no queue. Estimates are still those of the times at which they were due online.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.errors import DctorqueError
from dctorque_can.estimators.kalman import lasting, smoother, tape
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.arrivals import Arrivals, without_delays
from dctorque_can.pipeline.estimates import ESTIMATE, Estimates, Status
from dctorque_can.pipeline.estimator import BY_PERIOD, Estimator, Moment
from dctorque_can.pipeline.hindsight import Hindsight, against_gears
from dctorque_can.pipeline.samples import Samples
from dctorque_can.pipeline.settings import Settings

SEGMENT = 1024  # samples; their tape fits but for odd traffic, and then the segment is halved
_FORTH = 0.3  # share of the time that the second way forwards takes
_TORQUES = ("clutch1_torque_nm", "clutch2_torque_nm", "output_torque_nm")
_SIGMAS = ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm")
_VALID = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID)
_LIMITED = int(Status.LIMITED)


class _Segment(NamedTuple):
    """Some samples, after which of them estimates are wanted, and the estimates."""

    samples: Samples
    wanted: NDArray[np.bool_]
    rows: NDArray[np.void]


class _Before(NamedTuple):
    """What was before a segment: the estimator, and `lasting.SENSITIVITY` ``[1]``."""

    estimator: Moment
    errors: NDArray[np.void]


class Smoother:
    """An `Estimator` that can be asked, after all samples were fed, what all of them say of every moment.

    Memory grows with the recording: 19 bytes per sample, 152 per estimate and, while it is smoothed, 152 more and
    15 kB for each segment or each call of `feed`, whichever is shorter.

    Args:
        settings: vehicle, inputs and design.
        segment: how many samples have a tape at one time; the result does not depend on it.

    Raises:
        DctorqueError: the method is not the Kalman filter; and those of `Estimator`.
    """

    def __init__(self, settings: Settings, segment: int = SEGMENT) -> None:
        if settings.method is not Method.KALMAN:
            raise DctorqueError(
                f"estimator.method: {settings.method.name.lower()} cannot be smoothed: it has no covariances; use "
                "kalman (in the vehicle file, or --set estimator.method=kalman)"
            )
        self._settings = settings
        delayed = any(item.delay_us for item in settings.inputs)
        self._arrivals = Arrivals(settings) if delayed else None
        self._estimator = Estimator(settings)
        self._length = segment
        self._begin()

    def _begin(self) -> None:
        self._segments: list[_Segment] = []
        self._hindsight = Hindsight(self._estimator.diary)
        self._first: Moment | None = None

    @property
    def health(self) -> NDArray[np.void]:
        """`HEALTH` ``[1]``: the counters at the time of the last frame."""
        return self._estimator.health

    def feed(self, samples: Samples) -> Estimates:
        """Take samples in order of arrival and return the estimates that became due, as `Estimator.feed` does."""
        if self._arrivals is None:
            return self._feed(samples, BY_PERIOD)
        given = []
        for part in self._arrivals.split(samples):
            given.append(self._estimator.feed(part))
            self._arrivals.add(part, given[-1].rows["t_us"])
        return joined(given)

    def _feed(self, samples: Samples, wanted: NDArray[np.bool_]) -> Estimates:
        """Feed in segments, and keep them; ``wanted`` as in `Estimator.feed`."""
        found = []
        for first in range(0, len(samples), self._length):
            part = slice(first, first + self._length)
            if self._first is None:
                self._first = self._estimator.snapshot()
            found.append(self._estimator.feed(samples[part], wanted[part]))
            self._hindsight.collect(self._estimator.diary)
            self._segments.append(_Segment(samples[part], wanted[part], found[-1].rows.copy()))
        return joined(found) if found else self._estimator.feed(samples)

    def smoothed(self, progress: Callable[[float], None] = lambda fraction: None) -> NDArray[np.void]:
        """Return `ESTIMATE` ``[n]``: all rows that `feed` gave, with smoothed torques, sigmas and correlation.

        Everything else in a row, its status too, is as the estimator gave it online; but a smoothed torque that
        had to be limited says so. With delays it is as the estimator would have given it if nothing came late.
        """
        online = self._estimator
        if self._arrivals is not None:
            self._estimator = Estimator(without_delays(self._settings))
            self._begin()
            for samples, wanted in self._arrivals.in_order():
                self._feed(samples, wanted)
        if self._first is None:
            self._estimator = online
            return np.zeros(0, ESTIMATE)
        end = self._estimator.snapshot()
        self._estimator.restore(self._first)
        errors, before = np.zeros(1, lasting.SENSITIVITY), []
        for n, segment in enumerate(self._segments):
            self._hindsight.foretell(self._estimator.diary, n)
            before.append(_Before(self._estimator.snapshot(), errors.copy()))
            self._go_forth(segment.samples, segment.wanted, errors)
            progress(_FORTH * (n + 1) / len(self._segments))
        adjoint = np.zeros(1, smoother.ADJOINT)
        rows = np.concatenate([segment.rows for segment in self._segments])
        rest = len(rows)
        for n, segment in enumerate(reversed(self._segments)):
            start = before.pop()
            self._estimator.restore(start.estimator)
            against = against_gears(self._estimator.diary, segment.rows)
            found = self._go_back(segment.samples, segment.wanted, start.errors, adjoint)
            _replace(rows[rest - len(found) : rest], found, self._estimator.torque_limits, against)
            rest -= len(found)
            progress(_FORTH + (1.0 - _FORTH) * (n + 1) / len(self._segments))
        self._estimator.restore(end)
        tape.rewind(self._tape, on=False)
        self._estimator = online
        return rows

    @property
    def _tape(self) -> NDArray[np.void]:
        found: NDArray[np.void] = self._estimator.chosen.state["tape"]
        return found

    def _tape_of(self, samples: Samples, wanted: NDArray[np.bool_]) -> NDArray[np.void] | None:
        """Feed with the tape on and return the rows; None, and nothing is fed, when they have no room on it."""
        before = self._estimator.snapshot()
        tape.rewind(self._tape, on=True)
        rows = self._estimator.feed(samples, wanted).rows
        if not self._tape["full"][0]:
            return rows
        if len(samples) == 1:
            raise RuntimeError("what one sample does has no room on the tape: make it longer")
        self._estimator.restore(before)
        return None

    def _go_forth(self, samples: Samples, wanted: NDArray[np.bool_], errors: NDArray[np.void]) -> None:
        """Carry what lasting errors do over the next ``samples``; those that have no room in halves."""
        if self._tape_of(samples, wanted) is None:
            for part in _halves(samples):
                self._go_forth(samples[part], wanted[part], errors)
            return
        k = self._estimator.chosen
        lasting.go_forth(k.state, k.tables, k.tuning, errors)

    def _go_back(
        self,
        samples: Samples,
        wanted: NDArray[np.bool_],
        errors: NDArray[np.void],
        adjoint: NDArray[np.void],
    ) -> NDArray[np.void]:
        """Return `SMOOTHED` of the next ``samples``; carry the adjoint from their end to their beginning.

        What has no room on the tape is done in halves. ``errors`` are those before the samples.
        """
        before = self._estimator.snapshot()
        rows = self._tape_of(samples, wanted)
        if rows is None:
            first, second = _halves(samples)
            later = errors.copy()
            self._go_forth(samples[first], wanted[first], later)
            late = self._go_back(samples[second], wanted[second], later, adjoint)
            self._estimator.restore(before)
            return np.concatenate([self._go_back(samples[first], wanted[first], errors, adjoint), late])
        found = np.zeros(len(rows), smoother.SMOOTHED)
        k = self._estimator.chosen
        lasting.go_forth(k.state, k.tables, k.tuning, errors)
        smoother.go_back(k.state, k.tables, adjoint, found)
        return found


def _halves(samples: Samples) -> tuple[slice, slice]:
    half = len(samples) // 2
    return slice(0, half), slice(half, len(samples))


def joined(found: Sequence[Estimates]) -> Estimates:
    """Return estimates one after the other; at least one."""
    return Estimates(np.concatenate([e.rows for e in found]), np.concatenate([e.health for e in found]))


def _replace(
    rows: NDArray[np.void],
    smoothed: NDArray[np.void],
    limits: NDArray[np.float64],
    against: NDArray[np.bool_],
) -> None:
    """Put smoothed values into rows, within ±limits; those that are no numbers leave their row as it is.

    Who knows more is not less sure. But while the car rolls ``against`` its gears, the estimator may have taken it
    to go the other way.
    """
    good = np.isfinite(smoothed["torque"]).all(axis=1)
    torque = np.clip(smoothed["torque"], -limits, limits)
    sigma = np.minimum(smoothed["sigma"], limits)
    for n, (name, sigma_name) in enumerate(zip(_TORQUES, _SIGMAS, strict=True)):
        rows[name][good] = torque[good, n]
        sure = np.where(against, sigma[:, n], np.minimum(sigma[:, n], rows[sigma_name]))
        rows[sigma_name][good] = sure[good]
    rows["clutch_torque_sum_nm"][good] = torque[good, 0] + torque[good, 1]
    rows["clutch_correlation"][good] = smoothed["correlation"][good]
    limited = good & (torque != smoothed["torque"]).any(axis=1)
    rows["status"][limited] = (rows["status"][limited] & ~np.uint32(_VALID)) | _LIMITED
