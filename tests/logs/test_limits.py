"""Small files that unpack to much: refused within a stated limit, soon, in little memory."""

import gzip
import resource
import subprocess
import sys
from functools import cache

import lz4.frame
import pytest
import zstandard

from dctorque_can.logs.limits import FREE_FILE, FREE_PIECE, LARGEST_CHUNK, MIB, MOST_RATIO, Unpacked

from .blf.crafted import can_message, container, write_blf
from .mcap.crafted import cdr_frame, chunk, definitions, message, write_mcap
from .reading import READ

MOST_S, MOST_BYTES = 30, 1 << 30
MEMORY = "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
"""Its most memory, kB, since it is itself: ru_maxrss has that of the process it was forked from, too."""


def processor_s():
    """Return the processor time of all processes that have ended, whatever else the machine does, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def read_in_bounds(path):
    """Return frames and problems as another process reads them, with the time and memory that it may take."""

    def limit():
        resource.setrlimit(resource.RLIMIT_DATA, (2 * MOST_BYTES, 2 * MOST_BYTES))

    began = processor_s()
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            READ + MEMORY,
            path,
        ],
        capture_output=True,
        text=True,
        timeout=300,
        preexec_fn=limit,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    count, *problems, kilobytes = done.stdout.splitlines()
    assert processor_s() - began < MOST_S
    assert 1024 * int(kilobytes) < MOST_BYTES
    return int(count), problems


def packed_zeros(compression, size):
    if compression == "lz4":
        return lz4.frame.compress(bytes(size))
    packing = zstandard.ZstdCompressor(level=1).compressobj()  # a stream does not say its size
    return packing.compress(bytes(size)) + packing.flush()


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
@pytest.mark.parametrize("told", [480 * MIB, 1000, 0])
def test_a_chunk_of_zeros(tmp_path, compression, told):
    good = chunk(message(cdr_frame(1)))
    bomb = chunk(b"", compression, told, packed_zeros(compression, 480 * MIB))
    count, problems = read_in_bounds(write_mcap(tmp_path / "x.mcap", definitions(), good, bomb, good))
    assert count == 2
    assert len(problems) == 1
    if told != 1000:
        assert "a chunk unpacks to more than" in problems[0] or told == 0


def test_many_chunks_of_zeros(tmp_path):
    good = chunk(message(cdr_frame(1)))
    bomb = chunk(b"", "zstd", FREE_PIECE, packed_zeros("zstd", FREE_PIECE))
    count, problems = read_in_bounds(write_mcap(tmp_path / "x.mcap", definitions(), good, *[bomb] * 40))
    assert count == 1
    assert f"the file unpacks to more than {MOST_RATIO} times its size" in problems[-1]


def test_many_containers(tmp_path):
    bomb = container(can_message(1) * (FREE_PIECE // 48 - 1))
    path = write_blf(tmp_path / "x.blf", container(can_message(2)), *[bomb] * 20)
    count, problems = read_in_bounds(path)
    size = max(FREE_FILE, MOST_RATIO * path.stat().st_size) + FREE_PIECE
    assert 1 < count < size / 48
    assert "the file unpacks to more than" in problems[-1]


def test_containers_with_a_frame_each_do_not_keep_room_for_many(tmp_path):
    unknown = b"LOBJ\x20\0\1\0" + (4 << 20).to_bytes(4, "little") + bytes((4 << 20) - 12)
    filled = container(can_message(1) + unknown)
    count, _ = read_in_bounds(write_blf(tmp_path / "x.blf", *[filled] * 60))
    assert count == 60


@cache
def many_spaces():
    return gzip.compress((b" " * 50_000 + b"\n") * ((FREE_FILE + 8 * MIB) // 50_000), 9)


@pytest.mark.parametrize("suffix", [".log", ".asc", ".csv", ".trc"])
def test_gzipped_text(tmp_path, suffix):
    line = {
        ".log": b"(1700000000.000000) can0 123#00\n",
        ".asc": b"0.010000 1  123             Rx   d 1 00\n",
        ".csv": b"time,id,data\n0.01,123,00\n",
        ".trc": b";$FILEVERSION=1.1\n 1)  1.0  Rx  0123  1  00\n",
    }[suffix]
    path = tmp_path / f"x{suffix}.gz"
    path.write_bytes(gzip.compress(line) + many_spaces())
    count, problems = read_in_bounds(path)
    assert count == 1
    assert "unpacks to more than" in problems[-1]


def test_the_limits_of_pieces_and_files():
    small = Unpacked(1000)
    assert small.left == FREE_FILE
    assert small.most(10, LARGEST_CHUNK) == FREE_PIECE
    assert small.most(MIB, LARGEST_CHUNK) == MOST_RATIO * MIB
    assert small.most(2 * MIB, LARGEST_CHUNK) == LARGEST_CHUNK
    small.take(FREE_FILE - 5)
    assert small.most(10, LARGEST_CHUNK) == 5
    assert Unpacked(100 * MIB).left == 100 * MOST_RATIO * MIB
