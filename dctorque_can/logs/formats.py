"""Which format a file has: the suffix says it, and the content must agree."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

from dctorque_can.logs.errors import LogReadError

FORMATS = (".asc", ".blf", ".log", ".trc", ".csv", ".mf4", ".mcap")
TEXT_FORMATS = (".asc", ".log", ".trc", ".csv")
_KNOWN = ", ".join(FORMATS) + f"; of these {', '.join(TEXT_FORMATS)} also gzipped (.asc.gz)"
_MAGIC = {b"LOGG": ".blf", b"\x89MCAP": ".mcap", b"MDF ": ".mf4", b"UnFinMF ": ".mf4", b"\x1f\x8b": ".gz"}
_HEAD_SIZE = 4096

# One line of this form must be among the first ones.
_LINES = {
    ".asc": (
        re.compile(
            rb"^\s*(date\s|base\s+(hex|dec)|//|(no\s+)?internal\s+events|begin\s+trig|\d+\.\d+\s)", re.I | re.M
        ),
        "'base hex  timestamps absolute'",
    ),
    ".log": (
        re.compile(rb"^\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-F]+#", re.I | re.M),
        "'(1700000000.000000) can0 123#0102'",
    ),
    ".trc": (re.compile(rb"^\s*(;|\d+\)?\s+\d+(\.\d+)?\s)", re.M), "';$FILEVERSION=2.1'"),
    ".csv": (
        re.compile(rb"^([^,\n]*,){6}[^,\n]*$", re.M),
        "'timestamp,arbitration_id,extended,remote,error,dlc,data' as python-can writes it",
    ),
}


def checked_format(path: Path) -> tuple[str, bytes]:
    """Return the format of a log as a suffix without ``.gz``, and the first bytes of its text (decompressed).

    Raises:
        LogReadError: no such file, no such format, empty, or its content is not what its suffix says.
    """
    if path.is_dir():
        raise LogReadError(f"{path}: is a directory; give one log file: {_KNOWN}")
    if not path.exists():
        raise LogReadError(f"{path}: there is no such file")
    suffixes = [suffix.lower() for suffix in path.suffixes[-2:]]
    zipped = suffixes[-1:] == [".gz"]
    suffix = "".join(suffixes[:-1] if zipped else suffixes[-1:])
    if suffix not in (TEXT_FORMATS if zipped else FORMATS):
        raise LogReadError(f"{path}: the suffix says no known log format; known are {_KNOWN}")
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_SIZE)
    except OSError as error:
        raise LogReadError(f"{path}: can not be read: {error.strerror}") from error
    if not head:
        raise LogReadError(f"{path}: is empty")
    _check_magic(path, head, ".gz" if zipped else suffix)
    if zipped:
        try:
            head = zlib.decompressobj(31).decompress(head)
        except zlib.error as error:
            raise LogReadError(f"{path}: is no gzip file: {error}") from error
    if suffix in TEXT_FORMATS:
        _check_text(path, head, suffix)
    return suffix, head


def _check_magic(path: Path, head: bytes, expected: str) -> None:
    content = next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), "")
    if content == expected or (not content and expected in TEXT_FORMATS):
        return
    hint = f"; by its first bytes it is {content}" if content else ""
    raise LogReadError(f"{path}: is no {expected} file{hint}")


def _check_text(path: Path, head: bytes, suffix: str) -> None:
    pattern, example = _LINES[suffix]
    if b"\0" in head:
        raise LogReadError(f"{path}: is no {suffix} file: it is not text")
    if not pattern.search(head.replace(b"\r", b"\n")):
        raise LogReadError(f"{path}: is no {suffix} file: no line at its beginning looks like {example}")
