"""How far estimates are from the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.estimates import Status

TORQUES: Mapping[str, str] = {
    "clutch1_nm": "clutch1_torque_nm",
    "clutch2_nm": "clutch2_torque_nm",
    "output_nm": "output_torque_nm",
}
"""Short name of a compared torque to the field that estimates and truth share."""
VALID: Mapping[str, Status] = {
    "clutch1_nm": Status.CLUTCH1_VALID,
    "clutch2_nm": Status.CLUTCH2_VALID,
    "output_nm": Status.OUTPUT_VALID,
}
"""… to the bit that calls it valid."""


@dataclass(frozen=True, slots=True)
class ErrorFigures:
    """Errors of one torque, N·m; estimate minus truth.

    Attributes:
        rms: root mean square.
        bias: mean.
        peak: largest magnitude.
        peak_t_us: when that was.
    """

    rms: float
    bias: float
    peak: float
    peak_t_us: int


def compare(estimates: NDArray[np.void], truth: NDArray[np.void]) -> dict[str, ErrorFigures]:
    """Compare each torque of `TORQUES` at the times of the estimates, all of them, also before convergence.

    Args:
        estimates: `ESTIMATE` ``[n]``.
        truth: rows with ``t_us`` (ascending, on the time scale of the estimates) and the same torque fields;
            it is interpolated linearly. Estimates outside its time are left out.

    Raises:
        DctorqueError: no estimate lies within the time of the truth.
    """
    inside = estimates[_inside(estimates["t_us"], truth["t_us"])]
    if not len(inside):
        raise DctorqueError("there is nothing to compare: no estimate lies within the time of the truth")
    return {name: _figures(inside, truth, field) for name, field in TORQUES.items()}


def _inside(t_us: NDArray[np.int64], truth_us: NDArray[np.int64]) -> NDArray[np.bool_]:
    if not len(truth_us):
        return np.zeros(len(t_us), np.bool_)
    return np.asarray((t_us >= truth_us[0]) & (t_us <= truth_us[-1]))


def _figures(estimates: NDArray[np.void], truth: NDArray[np.void], field: str) -> ErrorFigures:
    start = truth["t_us"][0]  # relative times keep µs exact in float64
    true = np.interp(estimates["t_us"] - start, truth["t_us"] - start, truth[field])
    error = estimates[field] - true
    worst = int(np.argmax(np.abs(error)))
    return ErrorFigures(
        rms=float(np.sqrt(np.mean(error**2))),
        bias=float(np.mean(error)),
        peak=float(abs(error[worst])),
        peak_t_us=int(estimates["t_us"][worst]),
    )
