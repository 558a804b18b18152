"""Where in the chunks of a file messages stand; without python-can, which closing a torn log does not need."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dctorque_can.logs.mcap.compression import DamagedRecordError
from dctorque_can.logs.mcap.file import Lost, McapFile
from dctorque_can.logs.mcap.records import messages_end, record_end, skip_unknown


def message_spans(file: McapFile, records: NDArray[np.uint8], cut: bool = False) -> Iterator[tuple[int, int]]:
    """Yield where in ``records`` messages stand in a row; definitions between them go to ``file``.

    A record that can not be whole ends them, and what is lost is noted, unless they are known to be ``cut`` off.
    """
    position = 0
    while position < len(records):
        end = int(messages_end(records, position))
        if end > position:
            yield position, end
        position = int(skip_unknown(records, end))
        if position > end or position == len(records):
            continue
        after = int(record_end(records, position))
        if after < 0:
            if not cut:
                lost = len(records) - position
                file.lost.append(Lost(file.position, lost, "in the chunk before it a record is damaged"))
            break
        try:
            file.definitions.learn(records[position:after].tobytes())
        except DamagedRecordError as error:
            file.lost.append(Lost(file.position, 0, f"in the chunk before it: {error}"))
        position = after
