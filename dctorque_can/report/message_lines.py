"""What was wrong with the frames of each message, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dctorque_can.analysis.message_faults import BAD, WORDS


def message_lines(messages: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield a line for each message with bad frames (`analysis.message_faults`)."""
    for name, counts in messages.items():
        faults = ", ".join(
            f"{counts[key]} {WORDS[status]}" for status in BAD if (key := status.name.lower()) in counts
        )
        end = "" if counts["believed"] else "; not believed at the end"
        yield f"{name}: of {counts['frames']} frames {faults}{end}"
