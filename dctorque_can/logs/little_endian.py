"""Numbers out of bytes, for the compiled readers of binary logs."""

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled


@compiled
def little_endian(data: NDArray[np.uint8], position: int, size: int) -> int:
    """Return the unsigned number of ``size`` bytes at ``position``, which the caller has found to be there.

    A number of 8 bytes beyond 2^63 comes out negative.
    """
    value = np.uint64(0)
    for i in range(size):
        value |= np.uint64(data[position + i]) << np.uint64(8 * i)
    return np.int64(value)  # type: ignore[return-value]
