"""Tables and states of one coder in one piece of memory.

To hand an array of records over to compiled code costs some microseconds, ten times as much as to hand over one of
numbers; the arithmetic of a frame costs a tenth of one. So a call gets a single array of integers, and finds the
records in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def packed(*parts: NDArray[Any]) -> NDArray[np.int64]:
    """Return copies of all parts in one array: first where each begins and where the last one ends, then they.

    Args:
        parts: arrays of one dimension, whose items are made of whole words of eight bytes.
    """
    words = [part.view(np.int64) for part in parts]
    ends = len(parts) + 1 + np.cumsum([0, *map(len, words)])
    return np.concatenate([ends, *words])
