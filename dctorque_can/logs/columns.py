"""The columns that the compiled readers of every format fill: one record, the same for all of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.frames import Frames


class FrameColumns(NamedTuple):
    """The arrays of `Frames`, in a form that compiled functions take; ``n`` rows of ``width`` bytes of data.

    A compiled reader names the arrays once, before its loop, and writes no row from ``n`` on.
    """

    t_us: NDArray[np.int64]
    can_id: NDArray[np.uint32]
    length: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    channel: NDArray[np.uint8]
    data: NDArray[np.uint8]

    @classmethod
    def of(cls, frames: Frames) -> FrameColumns:
        """Return the columns of ``frames`` themselves, no copy."""
        return cls(frames.t_us, frames.can_id, frames.length, frames.flags, frames.channel, frames.data)
