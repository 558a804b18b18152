"""What the word of an estimator is worth: errors, bands and confidence of the estimates that it calls valid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.confidence import lasting_ms, wrong
from dctorque_can.analysis.errors import TORQUES, VALID

BAND_SIGMA = 1.96
"""Half width of the 95 % band in σ."""
_ONE_EPISODE_US = 200_000  # what is apart by less is one episode


@dataclass(frozen=True, slots=True)
class Episode:
    """The longest stretch in which a torque was confidently wrong.

    Attributes:
        start_s: on the time of the truth.
        wrong_ms: for how long in all.
        error_nm: estimate minus truth where it was most σ.
        sigma_nm: there.
    """

    start_s: float
    wrong_ms: float
    error_nm: float
    sigma_nm: float


@dataclass(frozen=True, slots=True)
class Honesty:
    """One torque on one drive.

    Attributes:
        rows: number of estimates that are called valid.
        valid: their share.
        rms_nm: RMS error of these; None when there are none.
        held: share of these within the 95 % band; likewise.
        wrong_ms: for how long they were confidently wrong.
        episode: the longest such stretch; None when there is none.
    """

    rows: int
    valid: float
    rms_nm: float | None
    held: float | None
    wrong_ms: float
    episode: Episode | None


def honesty(estimates: NDArray[np.void], truth: NDArray[np.void]) -> dict[str, Honesty]:
    """Judge each torque of `TORQUES` by the estimates that are called valid.

    Args:
        estimates: rows with torques, standard deviations and status, ``t_us`` ascending, ``[n]``. Those outside
            the time of the truth are left out.
        truth: rows with ``t_us`` and the same torque fields, interpolated linearly.
    """
    t = estimates["t_us"]
    inside = estimates[(t >= truth["t_us"][0]) & (t <= truth["t_us"][-1])]
    return {name: _judge(name, inside, truth) for name in TORQUES}


def _judge(name: str, rows: NDArray[np.void], truth: NDArray[np.void]) -> Honesty:
    field, t = TORQUES[name], rows["t_us"]
    error = rows[field] - np.interp(t, truth["t_us"], truth[field])
    sigma = rows[name.replace("_nm", "_sigma_nm")]
    valid = (rows["status"] & np.uint32(VALID[name])) != 0
    count = int(np.count_nonzero(valid))
    lasting = lasting_ms(t)
    at = np.flatnonzero(wrong(name, error, sigma, rows["status"]))
    return Honesty(
        rows=count,
        valid=count / max(1, len(rows)),
        rms_nm=float(np.sqrt(np.mean(error[valid] ** 2))) if count else None,
        held=float(np.mean(np.abs(error[valid]) <= BAND_SIGMA * sigma[valid])) if count else None,
        wrong_ms=float(lasting[at].sum()),
        episode=_longest(at, t, error, sigma, lasting, int(truth["t_us"][0])) if len(at) else None,
    )


def _longest(
    at: NDArray[np.intp],
    t: NDArray[np.int64],
    error: NDArray[np.float64],
    sigma: NDArray[np.float64],
    lasting: NDArray[np.float64],
    start_us: int,
) -> Episode:
    stretches = np.split(at, np.flatnonzero(np.diff(t[at]) > _ONE_EPISODE_US) + 1)
    longest = max(stretches, key=lambda stretch: float(lasting[stretch].sum()))
    worst = longest[np.argmax(np.abs(error[longest]) / sigma[longest])]
    return Episode(
        start_s=float(t[longest[0]] - start_us) / 1e6,
        wrong_ms=float(lasting[longest].sum()),
        error_nm=float(error[worst]),
        sigma_nm=float(sigma[worst]),
    )
