"""Confidently wrong: a torque that is called valid, with a standard deviation, and is nowhere near the truth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.errors import VALID

BEYOND_SIGMA = 5.0
"""Standard deviations of an honest estimate that an error does not reach in a lifetime."""
BEYOND_NM: Mapping[str, float] = {"clutch1_nm": 10.0, "clutch2_nm": 10.0, "output_nm": 100.0}
"""N·m up to which an error is small, however sure the estimate was."""
_LONGEST_US = 100_000  # that an estimate stands for: after a gap nothing is estimated


def wrong(
    name: str, error: NDArray[np.float64], sigma: NDArray[np.float64], status: NDArray[np.uint32]
) -> NDArray[np.bool_]:
    """Return which estimates of a torque are confidently wrong ``[n]``; none where no σ is stated (NaN).

    Args:
        name: short name of the torque, see `errors.TORQUES`.
        error: N·m ``[n]``, estimate minus truth.
        sigma: N·m ``[n]``, stated standard deviation.
        status: ``[n]``, bits of `pipeline.estimates.Status`.
    """
    size = np.abs(error)
    valid = (status & np.uint32(VALID[name])) != 0
    return np.asarray(valid & (size > BEYOND_SIGMA * sigma) & (size > BEYOND_NM[name]))


def lasting_ms(t_us: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return for how long each estimate of one drive stands ``[n]``, ms: until the next one."""
    until = np.append(np.diff(t_us), np.diff(t_us[-2:]) if len(t_us) > 1 else 0)
    return np.asarray(np.clip(until[: len(t_us)], 0, _LONGEST_US) / 1000.0)
