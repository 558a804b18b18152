"""What was wrong with the frames of each mapped message, and whether it is believed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.samples import SampleStatus

BAD = [status for status in SampleStatus if status not in (SampleStatus.OK, SampleStatus.NOT_AVAILABLE)]
WORDS = {
    SampleStatus.OUT_OF_RANGE: "with a value out of range",
    SampleStatus.BAD_LENGTH: "too short for counter or checksum",
    SampleStatus.BAD_CRC: "with a wrong checksum",
    SampleStatus.BAD_COUNTER: "with a wrong counter",
    SampleStatus.NOT_BELIEVED: "right, but not believed",
    SampleStatus.BAD_RATE: "with a value that changed too fast",
}
"""What is wrong with frames, for people."""


def message_faults(names: Sequence[str], messages: NDArray[np.void]) -> dict[str, dict[str, Any]]:
    """Return what was wrong with the frames of each message by name; without those with which nothing was.

    Each has ``frames``, how many of them had each fault as their worst one, and whether it is ``believed`` now.

    Args:
        names: of the messages.
        messages: `MESSAGE_STATE` ``[n]`` of them.
    """
    found = {}
    for name, state in zip(names, messages, strict=True):
        counts = state["counts"]
        faults = {status.name.lower(): int(counts[status]) for status in BAD if counts[status]}
        if faults:
            found[name] = {"frames": int(counts.sum()), **faults, "believed": not state["doubted"]}
    return found
