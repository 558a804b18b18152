"""The links of an MF4 file, before asammdf follows them: it goes round in a ring for ever."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

_Onwards = tuple[tuple[int, tuple[bytes, ...]], ...]
_DATA = (b"##DT", b"##DZ", b"##DV", b"##SD", b"##DL", b"##HL", b"##LD", b"##CG")
_ONWARDS: dict[bytes, _Onwards] = {
    b"##HD": ((0, (b"##DG",)), (1, (b"##FH",)), (2, (b"##CH",)), (3, (b"##AT",)), (4, (b"##EV",))),
    b"##FH": ((0, (b"##FH",)),),
    b"##CH": ((0, (b"##CH",)), (1, (b"##CH",))),
    b"##AT": ((0, (b"##AT",)),),
    b"##EV": ((0, (b"##EV",)),),
    b"##DG": ((0, (b"##DG",)), (1, (b"##CG",)), (2, _DATA)),
    b"##CG": ((0, (b"##CG",)), (1, (b"##CN",))),
    b"##CN": ((0, (b"##CN",)), (1, (b"##CN", b"##CA", b"##DS", b"##CL", b"##CV", b"##CU"))),
    b"##HL": ((0, (b"##DL",)),),
    b"##DL": ((0, (b"##DL",)),),
}
"""Links of each kind of block that lead to its next one or first child, never back, and to what.

The data of a channel are left out: they may stand in a group, which is in the list of groups too.
"""

_HEAD = struct.Struct("<4s4xQQ")  # kind, size, number of links, which follow
_FIRST = 64  # behind the identification


def check_links(path: Path) -> None:
    """Check that every block follows one other at most, and is of a kind that may stand there.

    The walk ends: it visits no byte of the file twice.

    Raises:
        ValueError: two links lead to one block, or one to something else.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        waiting, seen = [_FIRST], set[int]()
        while waiting:
            at = waiting.pop()
            if at in seen:
                raise ValueError(f"two links lead to the block at byte {at}")
            seen.add(at)
            kind, links = _block(content, at)
            for number, kinds in _ONWARDS.get(kind, ()):
                link = links[number] if number < len(links) else 0
                if link and _block(content, link)[0] not in kinds:
                    raise ValueError(f"the block at byte {at} leads to byte {link}, where nothing fits")
                if link:
                    waiting.append(link)


def _block(content: mmap.mmap, at: int) -> tuple[bytes, tuple[int, ...]]:
    """Return kind and first links of the block at a byte; nothing where there is none."""
    if at + _HEAD.size > len(content):
        return b"", ()
    kind, _, count = _HEAD.unpack_from(content, at)
    count = min(count, 6, (len(content) - at - _HEAD.size) // 8)
    return kind, struct.unpack_from(f"<{count}Q", content, at + _HEAD.size)
