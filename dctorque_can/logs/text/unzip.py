"""The bytes of a text log, plain or gzipped, in pieces of limited size and number."""

from __future__ import annotations

import io
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TextIO

from dctorque_can.logs.limits import Unpacked, file_too_large

BLOCK_SIZE = 4 << 20
_GZIP = 31  # zlib's word for a gzip header


def pieces(path: Path, read: Callable[[float], None], problem: Callable[[str], None]) -> Iterator[bytes]:
    """Yield the bytes of a file, unpacked if its name ends in .gz, at most `BLOCK_SIZE` at once.

    Args:
        path: the file.
        read: told the share of the file that has been read.
        problem: told why there is no more.
    """
    zipped = path.suffix.lower() == ".gz"
    size = path.stat().st_size
    unpacked = Unpacked(size)
    inflate = zlib.decompressobj(_GZIP)
    with path.open("rb") as file:
        while part := file.read(BLOCK_SIZE // (8 if zipped else 1)):
            read(file.tell() / max(size, 1))
            while zipped and part:
                try:
                    data = inflate.decompress(part, BLOCK_SIZE)  # never more at once, whatever it unpacks to
                except zlib.error as error:
                    problem(f"compressed data are damaged: {error}")
                    return
                unpacked.take(len(data))
                if unpacked.left < 0:
                    problem(file_too_large())
                    return
                yield data
                part = inflate.unconsumed_tail or inflate.unused_data
                if inflate.eof and part:
                    inflate = zlib.decompressobj(_GZIP)
            if not zipped:
                yield part
    if zipped and not inflate.eof:
        yield inflate.flush()
        problem("the compressed file is cut off")


class _Pieces(io.RawIOBase):
    def __init__(self, parts: Iterator[bytes]) -> None:
        self._parts = parts
        self._rest = memoryview(b"")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: object) -> int:
        target = memoryview(buffer).cast("B")  # type: ignore[arg-type]
        while not self._rest:
            part = next(self._parts, None)
            if part is None:
                return 0
            self._rest = memoryview(part)
        count = min(len(target), len(self._rest))
        target[:count] = self._rest[:count]
        self._rest = self._rest[count:]
        return count


def text_of(path: Path, read: Callable[[float], None], problem: Callable[[str], None]) -> TextIO:
    """Return the text of `pieces` line by line: UTF-8, without a byte order mark, any line ends."""
    raw = _Pieces(pieces(path, read, problem))
    return io.TextIOWrapper(io.BufferedReader(raw, 1 << 16), encoding="utf-8-sig", errors="replace")
