"""How far a learned map is from the capacity that a simulated clutch really had, where it slipped."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.phases import ClutchPhase

_COVERED = 2.0  # standard deviations


@dataclass(frozen=True)
class MapErrors:
    """Map minus truth at the actuation, wherever the clutch slipped between two valid nodes.

    A map is held against the time after it, until the next one: what it predicts.

    Attributes:
        milliseconds: of slipping that were compared.
        rms_nm: RMS of the differences.
        rms_share: the same over the largest engine torque of the drive.
        bias_nm: their mean.
        worst_nm: the largest in magnitude.
        covered: share within two standard deviations.
        sigma_nm: RMS of these.
    """

    milliseconds: int
    rms_nm: float
    rms_share: float
    bias_nm: float
    worst_nm: float
    covered: float
    sigma_nm: float

    def as_json(self) -> dict[str, Any]:
        """Return the figures for scripts."""
        return asdict(self)


def map_errors(
    rows: NDArray[np.void], truth: NDArray[np.void], clutch: int, actuation: NDArray[np.float64]
) -> MapErrors | None:
    """Hold the maps of one clutch against the truth; None: it slipped nowhere that a map was valid.

    Args:
        rows: `CLUTCH_MAP` ``[n]`` of any clutches, in order of time.
        truth: of the drive, one row a millisecond.
        clutch: 1 or 2.
        actuation: of that clutch at each row of the truth ``[len(truth)]``, in the unit of the maps; NaN where it
            is not known.
    """
    rows = rows[rows["clutch"] == clutch]
    found: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    ends = [*rows["t_us"][1:].tolist(), np.iinfo(np.int64).max][: len(rows)]
    slips = truth[f"phase{clutch}"] == ClutchPhase.SLIPPING
    for row, end in zip(rows, ends, strict=True):
        first, last = np.searchsorted(truth["t_us"], [row["t_us"], end])
        part, acts = truth[first:last][slips[first:last]], actuation[first:last][slips[first:last]]
        order = np.argsort(row["actuation"], kind="stable")
        grid, valid = row["actuation"][order], row["valid"][order] > 0
        x = np.nan_to_num(acts, nan=np.inf)
        place = np.clip(np.searchsorted(grid, x) - 1, 0, len(grid) - 2)
        inside = (x >= grid[0]) & (x <= grid[-1]) & valid[place] & valid[place + 1]
        x, capacity = x[inside], part[f"clutch{clutch}_capacity_nm"][inside]
        error = np.interp(x, grid, row["capacity_nm"][order]) - capacity
        found.append((error, np.interp(x, grid, row["sigma_nm"][order])))
    errors = np.concatenate([np.zeros(0), *(error for error, _ in found)])
    sigmas = np.concatenate([np.zeros(0), *(sigma for _, sigma in found)])
    if not len(errors):
        return None
    rms = float(np.sqrt(np.mean(errors**2)))
    return MapErrors(
        milliseconds=len(errors),
        rms_nm=rms,
        rms_share=rms / float(truth["engine_torque_nm"].max()),
        bias_nm=float(errors.mean()),
        worst_nm=float(errors[np.argmax(np.abs(errors))]),
        covered=float(np.mean(np.abs(errors) <= _COVERED * sigmas)),
        sigma_nm=float(np.sqrt(np.mean(sigmas**2))),
    )
