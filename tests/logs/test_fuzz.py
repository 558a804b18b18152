"""Small logs of every format with bytes, sizes and counts changed by a seeded generator: frames, or words."""

import random
import struct

import pytest

from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.layout import FD_FRAME_TYPE
from dctorque_can.logs.mcap.recover import recover
from dctorque_can.logs.reader import open_log

from .blf.crafted import blf_object, can_message, container, write_blf
from .frames_strategy import frame, frames_of
from .mcap.crafted import cdr_fd_frame, cdr_frame, chunk, definitions, message, write_mcap

ROUNDS = 150
NUMBERS = (0, 1, 7, 8, 9, 15, 16, 31, 32, 63, 64, 65, 127, 128, 255)
WIDE_NUMBERS = (
    0,
    1,
    16,
    0x7FFF,
    0xFFFF,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFF,
    (1 << 63) - 1,
    1 << 63,
    (1 << 64) - 1,
)
TEXT_BYTES = b" \t\r\n#.:xdRTr()0123456789abcdefCANFD\x00\xff\x7f"


def mutated(content, rng, is_text=False):
    """Return ``content`` with one to eight bytes or numbers of other values, or a piece gone or doubled."""
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        kind, place = rng.random(), rng.randrange(len(changed))
        if is_text and kind < 0.6:
            changed[place] = rng.choice(TEXT_BYTES)
        elif kind < 0.4:
            changed[place] = rng.choice(NUMBERS)
        elif kind < 0.7:
            size = rng.choice((2, 4, 8))
            changed[place : place + size] = (rng.choice(WIDE_NUMBERS) & ((1 << 8 * size) - 1)).to_bytes(
                size, "little"
            )
        elif kind < 0.85:
            del changed[place : place + rng.randrange(1, 40)]
        else:
            changed[place:place] = changed[place // 2 : place // 2 + rng.randrange(1, 40)]
        if not changed:
            break
    return bytes(changed)


def blf_objects():
    fd = struct.pack("<HBBLLBBB5x64s", 1, 0, 15, 7, 0, 0, 1, 64, bytes(range(64)))
    fd64 = struct.pack("<BBBBLLLLLLLHBBL", 1, 15, 64, 0, 7, 0, 0x1000, *[0] * 8) + bytes(range(64))
    error = struct.pack("<HHLBBBxLLH2x8s", 1, 0, 0, 0, 0, 8, 0, 5, 0, b"12345678")
    return b"".join(
        [
            can_message(1),
            blf_object(100, fd),
            blf_object(101, fd64),
            blf_object(73, error),
            blf_object(86, bytes(24)),
        ]
        * 4
    )


def mcap_records():
    return b"".join([message(cdr_frame(1)), message(cdr_fd_frame(2), channel=8), message(b"", channel=9)] * 4)


def read(path):
    """Return the number of frames and whether anything was told; nothing but a refusal may be raised."""
    try:
        log = open_log(path)
    except LogReadError:
        return 0, True
    with log:
        count = sum(map(len, log.frames()))
        assert log.fraction == 1.0
        assert all(line.startswith(str(path)) for line in log.problems)
        return count, bool(log.problems)


@pytest.mark.parametrize("seed", [1, 2])
def test_the_objects_of_blf_containers(tmp_path, seed):
    rng = random.Random(seed)
    whole = blf_objects()
    path = tmp_path / "x.blf"
    assert read(write_blf(path, container(whole))) == (20, False)
    told = 0
    for _ in range(ROUNDS):
        objects = mutated(whole, rng)
        count, problems = read(write_blf(path, container(objects, method=rng.choice((0, 2))), container(whole)))
        assert 0 <= count <= (len(objects) + len(whole)) // 40
        told += problems
    assert told > ROUNDS // 5


@pytest.mark.parametrize("seed", [1, 2])
def test_the_records_of_mcap_chunks(tmp_path, seed):
    """Without checksum, so that what was changed is read."""
    rng = random.Random(seed)
    outside = definitions(number=7) + definitions(FD_FRAME_TYPE, number=8)
    whole = mcap_records()
    path, out = tmp_path / "x.mcap", tmp_path / "y.mcap"
    assert read(write_mcap(path, outside, chunk(whole))) == (8, False)
    told = 0
    for _ in range(ROUNDS):
        records = mutated(whole, rng)
        compression = rng.choice(("", "lz4", "zstd"))
        count, problems = read(write_mcap(path, outside, chunk(records, compression), chunk(whole)))
        assert 0 <= count <= 20
        told += problems
        out.unlink(missing_ok=True)
        assert recover(path, out).messages >= count
    assert told > ROUNDS // 5


@pytest.mark.parametrize("suffix", [".asc", ".log", ".blf", ".mcap", ".csv", ".trc"])
def test_whole_files(tmp_path, suffix):
    rng = random.Random(suffix)
    path = tmp_path / f"x{suffix}"
    wide = suffix not in (".csv", ".trc")
    data = bytes(range(64)) if wide else bytes(8)
    rows = [
        frame(1_700_000_000_000_000 + 10_000 * i, 0x100 + i, data if i % 3 == 0 else data[: i % 9], channel=i % 2)
        for i in range(12)
    ]
    frames = frames_of(rows)
    frames.flags[frames.length > 8] = 1
    write_frames(path, frames)
    whole = path.read_bytes()
    assert read(path)[0] == 12
    for _ in range(ROUNDS):
        path.write_bytes(mutated(whole, rng, is_text=suffix not in (".blf", ".mcap")))
        count, told = read(path)
        assert 0 <= count <= 24
        assert count or told or suffix == ".blf"  # an object of another kind is no fault
