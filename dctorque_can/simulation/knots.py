"""Values over time, as drives give them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Knots = tuple[tuple[float, float], ...]
"""``(time in s, value)`` in ascending order; linear between, constant outside."""


def sampled(knots: Knots, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the values at the times ``t`` ``[n]`` in s; two knots at one time make a step."""
    times, values = np.array(knots, dtype=float).T
    after = np.clip(np.searchsorted(times, t, side="right"), 1, max(1, len(times) - 1))
    if len(times) == 1:
        return np.full(len(t), values[0])
    width = times[after] - times[after - 1]
    part = np.clip((t - times[after - 1]) / np.where(width > 0, width, 1.0), 0.0, 1.0)
    part = np.where(width > 0, part, (t >= times[after]).astype(float))
    return np.asarray(values[after - 1] + part * (values[after] - values[after - 1]))
