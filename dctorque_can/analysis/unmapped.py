"""Frames of which none is mapped, in sentences: what came instead, and what would be right."""

from __future__ import annotations

from dctorque_can.analysis.origins import identifier_text, listed
from dctorque_can.analysis.traffic import Traffic
from dctorque_can.pipeline.frames import EVERY_BIT, SOURCE

MOST_IDENTIFIERS = 8
MOST_MESSAGES = 12


def unmapped_lines(traffic: Traffic, holds: str) -> list[str]:
    """Return that no frame has a mapped identifier, and which came most; one line each.

    Args:
        traffic: of all frames, at least one.
        holds: what stands before the identifiers, such as "the log holds".
    """
    by_id = sorted(traffic.messages, key=lambda message: message.mapped.address.can_id)
    wanted = [str(message.origins) for message in by_id]
    seen = [f"{identifier_text(can_id)} ({count})" for can_id, count in traffic.most_seen(MOST_IDENTIFIERS)]
    return [
        f"none of the {traffic.frames} frames has a mapped identifier: {holds} {', '.join(seen)}; "
        f"mapped are {listed(wanted, MOST_MESSAGES)}",
        *other_source_lines(traffic),
    ]


def other_source_lines(traffic: Traffic) -> list[str]:
    """Return which messages did not come, but others of their J1939 number."""
    lines = []
    for message in traffic.messages:
        address = message.mapped.address
        if message.frames or not address.mask & SOURCE:
            continue
        others = [(can_id, count) for can_id, count in traffic.same_group(message) if can_id != address.can_id]
        if others:
            seen = listed([f"{identifier_text(can_id)} ({count})" for can_id, count in others], MOST_IDENTIFIERS)
            what = (
                "take another source address in `source_addresses:` of the database"
                if address.mask != EVERY_BIT
                else "is this J1939? Then say `j1939: true` of the database"
            )
            lines.append(f"{message.origins}: none came, but of its J1939 parameter group {seen}: {what}")
    return lines
