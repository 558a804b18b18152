"""What shows a finding, thinned to what an eye can see."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from dctorque_can.evidence.findings import Picture
from dctorque_can.evidence.moments import Mask
from dctorque_can.evidence.series import Floats

_MOST = 3000  # points


def thinned(x: Floats, y: Floats, where: Mask | None = None) -> tuple[Floats, Floats]:
    """Return the finite points, evenly thinned to `_MOST` of them."""
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y) & (True if where is None else where))
    rows = rows[:: max(1, -(-len(rows) // _MOST))]
    return x[rows], y[rows]


def against(
    labels: tuple[str, str], points: tuple[Floats, Floats], lines: Mapping[str, Callable[[Floats], Floats]]
) -> Picture:
    """Return a picture of points with lines over their whole extent.

    Args:
        labels: of both axes, with units.
        points: x and y ``[n]``.
        lines: y of x, by name.
    """
    x, y = points
    ends = np.linspace(float(x.min()), float(x.max()), 100) if len(x) else np.zeros(1)
    drawn = tuple((name, ends, np.asarray(line(ends), np.float64)) for name, line in lines.items())
    return Picture(*labels, x, y, drawn)
