"""Which format a file has: the suffix says it, and the content must agree."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.text.csv_dialect import NEEDED, dialect_of

FORMATS = (".asc", ".blf", ".log", ".trc", ".csv", ".mf4", ".mcap")
TEXT_FORMATS = (".asc", ".log", ".trc", ".csv")
_KNOWN = ", ".join(FORMATS) + f"; of these {', '.join(TEXT_FORMATS)} also gzipped (.asc.gz)"
_MAGIC = {b"LOGG": ".blf", b"\x89MCAP": ".mcap", b"MDF ": ".mf4", b"UnFinMF ": ".mf4", b"\x1f\x8b": ".gz"}
_HEAD_SIZE = 4096

SCREEN = rb"^\s*\([-: .0-9]+\)\s+\S+\s+(?:[TR]X\s+[-B] [-E]\s+)?[0-9A-F]{3,8}\s+[\[{]"
"""A line of candump on the screen with its time."""
_SCREEN_WITHOUT_TIME = re.compile(
    rb"^\s*\w+\s+(?:[TR]X\s+[-B] [-E]\s+)?[0-9A-F]{3,8}\s+(?:\[\d+\]|\{[0-9A-F]\})\s", re.I | re.M
)
BOM = b"\xef\xbb\xbf"
_COLOUR = re.compile(rb"\x1b\[[0-9;]*m")

# One line of this form must be among the first ones.
_LINES = {
    ".asc": (
        re.compile(
            rb"^\s*(date\s|base\s+(hex|dec)|//|(no\s+)?internal\s+events|begin\s+trig|-?\d+[.,]\d+\s)", re.I | re.M
        ),
        "'base hex  timestamps absolute'",
    ),
    ".log": (
        re.compile(rb"^\s*\(\d+\.\d+\)\s+\S+\s+[0-9A-F]+#|" + SCREEN, re.I | re.M),
        "'(1700000000.000000) can0 123#0102'",
    ),
    ".trc": (re.compile(rb"^\s*(;|\d+\)?\s+\d+(\.\d+)?\s)", re.M), "';$FILEVERSION=2.1'"),
    ".csv": (
        re.compile(rb"^([^,\n]*,){6}[^,\n]*$", re.M),
        "'timestamp,arbitration_id,extended,remote,error,dlc,data' as python-can writes it",
    ),
}


def is_of_python_can(head: bytes) -> bool:
    """Return whether a CSV begins as python-can writes it."""
    first = head.removeprefix(BOM).splitlines()[:1]
    return first == [b"timestamp,arbitration_id,extended,remote,error,dlc,data"]


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
    if head.startswith((b"\xff\xfe", b"\xfe\xff")) or re.match(rb"(?:[ -~]\0){4}|(?:\0[ -~]){4}", head):
        raise LogReadError(f"{path}: is UTF-16 text, as PowerShell writes it; save it as UTF-8")
    head = head.removeprefix(BOM)
    if b"\0" in head:
        raise LogReadError(f"{path}: is no {suffix} file: it is not text")
    lines = _COLOUR.sub(b"", head.replace(b"\r", b"\n"))
    if pattern.search(lines):
        return
    if suffix == ".csv" and dialect_of(lines.decode("utf-8", "replace")) is not None:
        return
    if suffix == ".csv":
        named = lines.split(b"\n", 1)[0].decode("utf-8", "replace")[:80]
        raise LogReadError(
            f"{path}: no line at its beginning looks like {example}, and its columns are not known: {named!r}; "
            f"needed is {NEEDED}"
        )
    if suffix == ".log" and _SCREEN_WITHOUT_TIME.search(lines):
        raise LogReadError(
            f"{path}: is the screen of candump without times; record with candump -L, or with candump -ta"
        )
    raise LogReadError(f"{path}: is no {suffix} file: no line at its beginning looks like {example}")
