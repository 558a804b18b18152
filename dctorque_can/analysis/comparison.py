"""How good the estimates of one estimator are over several drives: errors, lag, and what its σ are worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis import confidence
from dctorque_can.analysis.consistency import Bands, Nees, bands, nees
from dctorque_can.analysis.errors import TORQUES
from dctorque_can.analysis.lag import Stretch, lag_s
from dctorque_can.analysis.shifts import find_shifts
from dctorque_can.errors import DctorqueError

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

PADDING_US = 100_000
"""By how much a window is longer than its shift, before and after, µs."""

_SIGMAS: Mapping[str, str] = {
    "clutch1_nm": "clutch1_sigma_nm",
    "clutch2_nm": "clutch2_sigma_nm",
    "output_nm": "output_sigma_nm",
}


@dataclass(frozen=True, slots=True)
class TorqueFigures:
    """Errors of one torque, estimate minus truth; every estimate counts the same.

    Attributes:
        rms_nm: root mean square.
        rms_each_nm: … of each drive; None for one without such estimates.
        bias_nm: mean.
        peak_nm: largest magnitude.
        lag_ms: as `lag.lag_s` defines it; None when there is none to be told, or nobody asked.
        bands: of the stated standard deviations; None when the estimator states none.
        wrong_ms: for how long it was confidently wrong (`confidence`), over all drives; None likewise.
    """

    rms_nm: float
    rms_each_nm: tuple[float | None, ...]
    bias_nm: float
    peak_nm: float
    lag_ms: float | None
    bands: Bands | None
    wrong_ms: float | None


@dataclass(frozen=True, slots=True)
class Figures:
    """All figures over one choice of estimates.

    Attributes:
        samples: how many estimates these are.
        torques: by the short names of `errors.TORQUES`.
        clutches: of the stated covariance of both clutch torques; None when the estimator states none.
    """

    samples: int
    torques: dict[str, TorqueFigures]
    clutches: Nees | None


@dataclass(frozen=True, slots=True)
class Comparison:
    """One estimator against the truth.

    Attributes:
        everything: over all estimates, also those before convergence.
        shifts: over those within the windows of the shifts; None when there are no shifts.
    """

    everything: Figures
    shifts: Figures | None


def shift_windows(truth: NDArray[np.void]) -> NDArray[np.int64]:
    """Return first and last time of each shift of a drive ``[shift, 2]``, µs, both 100 ms outside of it."""
    times = [(truth["t_us"][s.start] - PADDING_US, truth["t_us"][s.end] + PADDING_US) for s in find_shifts(truth)]
    return np.array(times, np.int64).reshape(-1, 2)


def judge(drives: Sequence[tuple[NDArray[np.void], NDArray[np.void]]], lag: bool = True) -> Comparison:
    """Compare the estimates of one estimator with the truth, all drives together.

    Args:
        drives: of each drive `ESTIMATE` ``[n]``, and the truth ``[m]`` with ``t_us`` on the same time scale
            (ascending), the torques of `TORQUES`, phases and gears. The truth is interpolated linearly;
            estimates outside its time are left out.
        lag: work out the lag too, which takes nine tenths of the time.

    Raises:
        DctorqueError: a drive has no estimate within the time of its truth.
    """
    known = [_Drive(estimates, truth) for estimates, truth in drives]
    everything = _figures(
        known, [np.ones(len(d.t_us), np.bool_) for d in known], [[d.all_time] for d in known], lag
    )
    inside = [_within(d.t_us, d.windows) for d in known]
    found = any(rows.any() for rows in inside)
    shifts = _figures(known, inside, [list(d.windows) for d in known], lag) if found else None
    return Comparison(everything, shifts)


class _Drive:
    """One drive with the truth at the times of its estimates."""

    def __init__(self, estimates: NDArray[np.void], truth: NDArray[np.void]) -> None:
        t_us = estimates["t_us"]
        inside = (
            (t_us >= truth["t_us"][0]) & (t_us <= truth["t_us"][-1]) if len(truth) else np.zeros(len(t_us), bool)
        )
        if not inside.any():
            raise DctorqueError("there is nothing to compare: no estimate lies within the time of the truth")
        rows = estimates[inside]
        start = truth["t_us"][0]  # relative times keep µs exact in float64
        self.t_us: NDArray[np.int64] = rows["t_us"]
        self.t_s: Floats = (rows["t_us"] - start) / 1e6
        self.truth_t_us: NDArray[np.int64] = truth["t_us"]
        self.truth_t_s: Floats = (truth["t_us"] - start) / 1e6
        self.truth: dict[str, Floats] = {name: truth[field] for name, field in TORQUES.items()}
        self.estimate: dict[str, Floats] = {name: rows[field] for name, field in TORQUES.items()}
        self.sigma: dict[str, Floats] = {name: rows[field] for name, field in _SIGMAS.items()}
        self.correlation: Floats = rows["clutch_correlation"]
        self.error: dict[str, Floats] = {
            name: self.estimate[name] - np.interp(self.t_s, self.truth_t_s, self.truth[name]) for name in TORQUES
        }
        lasting_ms = confidence.lasting_ms(self.t_us)
        self.wrong_ms: dict[str, Floats] = {
            name: lasting_ms * confidence.wrong(name, self.error[name], self.sigma[name], rows["status"])
            for name in TORQUES
        }
        self.windows = shift_windows(truth)
        self.all_time = np.array([truth["t_us"][0], truth["t_us"][-1]], np.int64)

    def stretch(self, name: str, window: NDArray[np.int64]) -> Stretch:
        """Return estimates of one torque within a window of time, and all of its truth."""
        rows = _within(self.t_us, window[np.newaxis])
        return Stretch(self.t_s[rows], self.estimate[name][rows], self.truth_t_s, self.truth[name])


def _within(t_us: NDArray[np.int64], windows: NDArray[np.int64]) -> Flags:
    rows = np.zeros(len(t_us), np.bool_)
    for begin, end in windows:
        rows |= (t_us >= begin) & (t_us <= end)
    return rows


def _figures(
    drives: Sequence[_Drive],
    chosen: Sequence[Flags],
    windows: Sequence[Sequence[NDArray[np.int64]]],
    with_lag: bool,
) -> Figures:
    """Return the figures over the ``chosen`` rows of each drive, which are those within its ``windows``."""
    torques = {}
    for name in TORQUES:
        errors = [d.error[name][rows] for d, rows in zip(drives, chosen, strict=True)]
        error = np.concatenate(errors)
        sigma = np.concatenate([d.sigma[name][rows] for d, rows in zip(drives, chosen, strict=True)])
        stretches = [d.stretch(name, w) for d, spans in zip(drives, windows, strict=True) for w in spans]
        lag = lag_s(stretches) if with_lag else None
        held = bands(error, sigma)
        wrong_ms = sum(float(d.wrong_ms[name][rows].sum()) for d, rows in zip(drives, chosen, strict=True))
        torques[name] = TorqueFigures(
            rms_nm=_rms(error),
            rms_each_nm=tuple(_rms(one) if len(one) else None for one in errors),
            bias_nm=float(np.mean(error)),
            peak_nm=float(np.max(np.abs(error))),
            lag_ms=None if lag is None else 1000 * lag,
            bands=held,
            wrong_ms=None if held is None else wrong_ms,
        )
    clutches = nees(
        [(_pair(d.error), _pair(d.sigma), d.correlation, r) for d, r in zip(drives, chosen, strict=True)]
    )
    return Figures(sum(int(rows.sum()) for rows in chosen), torques, clutches)


def _rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _pair(columns: Mapping[str, Floats]) -> Floats:
    return np.stack([columns["clutch1_nm"], columns["clutch2_nm"]], axis=1)
