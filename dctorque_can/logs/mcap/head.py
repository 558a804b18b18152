"""What stands at the very head of an MCAP file: readable also when the rest is torn, or still being written."""

from __future__ import annotations

import os
import stat
import struct
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Metadata
from mcap.writer import MCAP0_MAGIC

from dctorque_can.logs.mcap.layout import RECORD_HEAD

_HEAD_BYTES = 1 << 16
# A name may be exchanged between a look at it and its opening: what is opened then must not be followed or hang.
_AS_IT_IS = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC


def first_metadata(path: Path) -> tuple[str, dict[str, str]] | None:
    """Return name and words of the metadata that follow the header record; None where there are none.

    A symbolic link, a directory and a device are no file; what is no MCAP file has no metadata.

    Raises:
        OSError: the file cannot be read.
    """
    if not stat.S_ISREG(path.lstat().st_mode):
        return None
    descriptor = os.open(path, _AS_IT_IS)
    try:
        head = os.read(descriptor, _HEAD_BYTES)
    finally:
        os.close(descriptor)
    if not head.startswith(MCAP0_MAGIC):
        return None
    position = len(MCAP0_MAGIC)
    for wanted in (Opcode.HEADER, Opcode.METADATA):
        end = position + RECORD_HEAD + int.from_bytes(head[position + 1 : position + RECORD_HEAD], "little")
        if position + RECORD_HEAD > len(head) or head[position] != wanted or end > len(head):
            return None
        body = head[position + RECORD_HEAD : end]
        position = end
    try:
        record = Metadata.read(ReadDataStream(BytesIO(body)))
    except (McapError, ValueError, OverflowError, struct.error):
        return None
    return record.name, record.metadata
