"""What a recording holds and what is missing in it, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dctorque_can.analysis.origins import identifier_text, listed, shared_lines
from dctorque_can.analysis.traffic import Traffic
from dctorque_can.analysis.unmapped import other_source_lines, unmapped_lines

MOST_TOPICS = 12
LATE_WORTH_TELLING = 0.01
"""Share of the mapped frames that are late, from which that is told."""


def holds_no_frames(path: str, unread: Sequence[str]) -> str:
    """Return that a log holds no frames, and what it holds instead."""
    what = f"; it holds {listed(unread, MOST_TOPICS)}, of which frames cannot be read" if unread else ""
    return f"{path}: the log holds no frames{what}"


def sorted_frames(path: str, moved: int, frames: int, by_us: int) -> str:
    """Return that frames were put in order of time."""
    return (
        f"{path}: {moved} of {frames} frames stood behind frames of a later time, by up to {by_us / 1000:.1f} ms: "
        "they were sorted (estimator.reorder_ms)"
    )


def not_our_own(unread: Sequence[str]) -> list[str]:
    """Return what is not read, without what this package has written itself."""
    return [item for item in unread if not item.startswith(("/dctorque/", "/signals/"))]


def unread_topics(path: str, unread: Sequence[str]) -> str:
    """Return what of a log that holds frames is not read."""
    return f"{path}: not read: {listed(unread, MOST_TOPICS)}"


def missing_lines(traffic: Traffic, health: Mapping[str, Any], reorder: str = "") -> list[str]:
    """Return what is missing in a recording, or came otherwise than an estimator needs it; one line each.

    Args:
        traffic: of all its frames, at least one.
        health: of `analysis.health.health_counts`.
        reorder: what to do about frames out of order, behind a semicolon.
    """
    mapped = traffic.mapped_frames
    if not mapped:
        return unmapped_lines(traffic, "the log holds")
    lines = []
    late, resets = health["late_frames"], health["clock_resets"]
    if late > LATE_WORTH_TELLING * mapped:
        lines.append(
            f"{late} of {mapped} mapped frames ({100 * late / mapped:.0f} %) are late: they stand behind frames "
            f"of a later time{reorder}"
        )
    if resets:
        times = "once" if resets == 1 else f"{resets} times"
        lines.append(
            f"the clock of the log went back {times} by more than estimator.max_step_back_ms: the estimator "
            "began anew; are these several recordings, or the parts of one in another order?"
        )
    return [
        *lines,
        *other_source_lines(traffic),
        *shared_lines([message.origins for message in traffic.messages]),
    ]


def short_lines(traffic: Traffic, lacking: bool) -> list[str]:
    """Return which mapped messages have frames that are shorter than their DBC says, one line each.

    With ``lacking`` those in which something is missing that is mapped, else those in which nothing is.
    """
    lines = []
    for message in traffic.messages:
        known = message.mapped
        if message.short and lacking == (message.shortest < known.needed):
            what = (
                "mapped signals behind the end are not available, and a counter or CRC there is an error"
                if lacking
                else "all mapped signals lie inside"
            )
            count = f"{message.short} of {message.frames} frames are shorter"
            lines.append(
                f"{known.name} ({identifier_text(known.address.can_id)}): {count} than the {known.length} bytes "
                f"of the DBC, down to {message.shortest}; {what}"
            )
    return lines
