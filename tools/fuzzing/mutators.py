"""Mutators that know a format: a change of any byte of a packed or counted file is refused at the door.

Each gets the bytes, atheris' own mutator of bytes, a random generator and the largest size. Some of what they do
is left to that mutator, so that broken containers are tried as well.
"""

from __future__ import annotations

import gzip
import random
import re
import struct
import zlib
from collections.abc import Callable
from itertools import pairwise

import lz4.frame
import zstandard

Bytes = Callable[[bytes, int], bytes]
Mutator = Callable[[bytes, Bytes, random.Random, int], bytes]

MOST_UNPACKED = 1 << 20
NUMBERS = (
    0,
    1,
    7,
    8,
    9,
    63,
    64,
    65,
    255,
    0x7FFF,
    0xFFFF,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFF,
    1 << 63,
    2**64 - 1,
)
WORDS = (
    *(
        b"",
        b"0",
        b"-1",
        b"1e308",
        b"1e-320",
        b"nan",
        b"-inf",
        b"0x7fffffffffffffff",
        b"99999999999999999999",
        b"1_0",
    ),
    *(
        b"\xff",
        b"\0",
        b"\xef\xbb\xbf",
        "٣".encode(),
        "²".encode(),
        b'"',
        b"'",
        b"{}",
        b"[]",
        b"null",
        b"true",
        b"~",
        b"<<",
    ),
)
_WORD = re.compile(rb"[^\s:,;(){}\[\]|#]+")
_NUMBER = re.compile(rb"-?\d{1,300}(\.\d+)?")
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_ATTACHMENT, _CHUNK = 9, 6


def bytes_only(data: bytes, change: Bytes, rng: random.Random, largest: int) -> bytes:
    return change(data, largest)


def lines(data: bytes, change: Bytes, rng: random.Random, largest: int) -> bytes:
    """Text: a number, a word, a line, or its bytes."""
    kind = rng.random()
    if kind < 0.25:
        return change(data, largest)
    words = list(_WORD.finditer(data))
    numbers = [word for word in words if _NUMBER.fullmatch(word.group())]
    if kind < 0.7 and words:
        if kind < 0.5 and numbers:  # the file may stay a good one
            word = rng.choice(numbers)
            other = _other_number(word.group(), rng)
        else:
            word = rng.choice(words)
            other = rng.choice(WORDS) if rng.random() < 0.4 else rng.choice(words).group()
        return (data[: word.start()] + other + data[word.end() :])[:largest]
    rows = data.split(b"\n")
    at = rng.randrange(len(rows))
    if kind < 0.8:
        del rows[at]
    elif kind < 0.9:
        rows.insert(rng.randrange(len(rows) + 1), rows[at])
    else:
        rows[at] = change(rows[at] or b" ", 2 * len(rows[at]) + 16)
    return b"\n".join(rows)[:largest]


def _other_number(word: bytes, rng: random.Random) -> bytes:
    value = float(word)
    kind = rng.randrange(4)
    if kind == 0:
        return b"%d" % (round(value) + rng.choice((-1, 1)))
    if kind == 1:
        return b"%.6g" % (value * 10.0 ** rng.randrange(-12, 13))
    return b"%d" % rng.choice(NUMBERS) if kind == 2 else word.replace(b"-", b"") if value < 0 else b"-" + word


def gzipped(data: bytes, change: Bytes, rng: random.Random, largest: int) -> bytes:
    """Gzipped text: what is inside, packed anew."""
    if rng.random() < 0.4:
        return change(data, largest)
    try:
        text = zlib.decompressobj(31).decompress(data, MOST_UNPACKED)
    except zlib.error:
        return change(data, largest)
    return gzip.compress(lines(text, change, rng, MOST_UNPACKED), mtime=0)[:largest]


def blf(data: bytes, change: Bytes, rng: random.Random, largest: int) -> bytes:
    """BLF: an object within a container, whose sizes are put right."""
    start = data.find(b"LOBJ")
    if start < 0 or rng.random() < 0.3:
        return change(data, largest)
    objects = _objects(data[start:])
    at = rng.randrange(len(objects))
    chosen = objects[at]
    if len(chosen) > 32 and chosen[12:16] == b"\x0a\0\0\0":
        method, size = struct.unpack_from("<H6xL", chosen, 16)
        try:
            inside = zlib.decompressobj().decompress(chosen[32:], MOST_UNPACKED) if method == 2 else chosen[32:]
        except zlib.error:
            inside = b""
        inside = b"".join(_changed(_objects(inside), _object_changed, change, rng))
        packed = zlib.compress(inside, 1) if method == 2 else inside
        told = len(inside) if rng.random() < 0.9 else size
        head = (
            chosen[:8] + struct.pack("<L", 32 + len(packed)) + chosen[12:16] + struct.pack("<H6xL4x", method, told)
        )
        objects[at] = head + packed + bytes(len(packed) % 4)
    else:
        objects = _changed(objects, _object_changed, change, rng)
    return (data[:start] + b"".join(objects))[:largest]


def _objects(data: bytes) -> list[bytes]:
    """Cut at the signature of BLF objects."""
    starts = [0, *(m.start() for m in re.finditer(rb"LOBJ", data) if m.start()), len(data)]
    return [data[a:b] for a, b in pairwise(starts)]


def _object_changed(item: bytes, change: Bytes, rng: random.Random) -> bytes:
    body = change(item[16:] or b"\0", len(item) + 64)
    size = 16 + len(body) if rng.random() < 0.8 else rng.choice(NUMBERS) & 0xFFFF_FFFF
    kind = (
        item[12:16] if rng.random() < 0.9 else struct.pack("<L", rng.choice((1, 2, 10, 73, 86, 96, 100, 101, 104)))
    )
    return item[:8] + struct.pack("<L", size) + kind + body


def mcap(data: bytes, change: Bytes, rng: random.Random, largest: int) -> bytes:
    """MCAP: a record, within a chunk if it is one, whose sizes and checksums are put right."""
    if not data.startswith(_MCAP_MAGIC) or rng.random() < 0.3:
        return change(data, largest)
    records = _records(data[8:])
    chunks = [at for at, each in enumerate(records) if each[:1] == bytes([_CHUNK])]
    if chunks and rng.random() < 0.7:
        at = rng.choice(chunks)
        records[at] = _chunk_changed(records[at], change, rng)
    else:
        records = _changed(records, _record_changed, change, rng)
    return (_MCAP_MAGIC + b"".join(records))[:largest]


def _records(data: bytes) -> list[bytes]:
    """Cut MCAP records; what is none comes last."""
    found: list[bytes] = []
    position = 0
    while position + 9 <= len(data):
        size = 9 + int.from_bytes(data[position + 1 : position + 9], "little")
        if position + size > len(data):
            break
        found.append(data[position : position + size])
        position += size
    return [*found, data[position:]]


def _record_changed(item: bytes, change: Bytes, rng: random.Random) -> bytes:
    body = change(item[9:] or b"\0", len(item) + 64)
    if item[:1] == bytes([_ATTACHMENT]) and len(body) > 4:
        body = body[:-4] + struct.pack("<L", zlib.crc32(body[:-4]))
    size = len(body) if rng.random() < 0.85 else rng.choice(NUMBERS)
    return item[:1] + struct.pack("<Q", size) + body


def _chunk_changed(item: bytes, change: Bytes, rng: random.Random) -> bytes:
    """Change the records of a chunk, which loses its checksum."""
    try:
        (named,) = struct.unpack_from("<L", item, 37)
        name = item[41 : 41 + named]
        packed = item[41 + named + 8 :]
        if name == b"zstd":
            inside = zstandard.ZstdDecompressor().decompressobj().decompress(packed)
        else:
            inside = lz4.frame.decompress(packed) if name == b"lz4" else packed
    except (struct.error, RuntimeError, ValueError, zstandard.ZstdError):
        return _record_changed(item, change, rng)
    inside = b"".join(_changed(_records(inside), _record_changed, change, rng))
    name = name if rng.random() < 0.9 else rng.choice((b"", b"lz4", b"zstd", b"zip"))
    packs: dict[bytes, Callable[[bytes], bytes]] = {b"lz4": lz4.frame.compress, b"zstd": zstandard.compress}
    packed = packs[name](inside) if name in packs else inside
    told = len(inside) if rng.random() < 0.9 else rng.choice(NUMBERS)
    body = item[9:25] + struct.pack("<QLL", told, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    return item[:1] + struct.pack("<Q", len(body)) + body


def _changed(
    parts: list[bytes], one: Callable[[bytes, Bytes, random.Random], bytes], change: Bytes, rng: random.Random
) -> list[bytes]:
    """Change one of the parts, or leave it out, double it, or swap it with another."""
    parts = list(parts)
    if not parts:
        return [change(b"\0", 64)]
    at, kind = rng.randrange(len(parts)), rng.random()
    if kind < 0.7:
        parts[at] = one(parts[at], change, rng)
    elif kind < 0.8:
        del parts[at]
    elif kind < 0.9:
        parts.insert(rng.randrange(len(parts) + 1), parts[at])
    else:
        other = rng.randrange(len(parts))
        parts[at], parts[other] = parts[other], parts[at]
    return parts
