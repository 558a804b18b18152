"""Killed writers, cut files, flipped bytes, full disks: what was written whole is read, the rest is told."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from dctorque_can.logs.errors import LogReadError, LogWriteError
from dctorque_can.logs.mcap.layout import EventLevel
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.recover import recover
from dctorque_can.logs.mcap.table import ESTIMATES
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import Frames

from ..frames_strategy import assert_same_frames, frame, frames_of

START = 1_700_000_000_000_000
CHUNK_FRAMES = 20
CHUNKS = 10


def numbered_frames(n, first=0):
    return frames_of([frame(START + i, 0x100 + i % 5, i.to_bytes(8, "big")) for i in range(first, first + n)])


def write_log(path, compression="lz4"):
    """Ten chunks of twenty frames, one event in front."""
    with McapLog(path, documents={"car.yaml": b"name: car"}, compression=compression) as log:
        log.write_event(START, EventLevel.INFO, "test", "begins")
        for i in range(CHUNKS):
            log.write_frames(numbered_frames(CHUNK_FRAMES, i * CHUNK_FRAMES))
            log.flush()


@pytest.fixture(scope="module")
def whole_log(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "log.mcap"
    write_log(path)
    return path


def numbers_of(frames):
    return [int.from_bytes(bytes(row), "big") for row in frames.data]


def read(path):
    log = open_log(path)
    return Frames.concatenate(log.frames()), log


@settings(max_examples=60)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_cut_file_gives_every_whole_chunk(whole_log, tmp_path_factory, share):
    path = tmp_path_factory.mktemp("cut") / "cut.mcap"
    content = whole_log.read_bytes()
    size = max(int(len(content) * share), 8)
    path.write_bytes(content[:size])
    frames, log = read(path)
    numbers = numbers_of(frames)
    assert numbers == list(range(len(numbers)))
    assert len(numbers) % CHUNK_FRAMES == 0
    with whole_log.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    whole = sum(chunk.chunk_start_offset + chunk.chunk_length <= size for chunk in chunks)
    assert len(numbers) == CHUNK_FRAMES * whole
    assert len(log.problems) == 1
    assert log.fraction == 1.0
    out = path.with_name("out.mcap")
    recovery = recover(path, out)
    again, clean = read(out)
    assert clean.problems == []
    assert numbers_of(again)[: len(numbers)] == numbers
    assert numbers_of(again) == list(range(len(again)))
    assert recovery.messages - recovery.messages_of_broken_chunk == len(numbers) + (whole > 0)


@pytest.mark.parametrize("compression", ["lz4", "zstd", ""])
def test_recover_saves_whole_records_of_the_broken_chunk(tmp_path, compression):
    """One big chunk (several blocks of lz4 or zstd) cut in the middle: its first half is there."""
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    with McapLog(path, compression=compression) as log:
        log.write_frames(numbered_frames(10_000))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 4])
    assert len(read(path)[0]) == 0
    recovery = recover(path, out)
    frames, _ = read(out)
    assert numbers_of(frames) == list(range(len(frames)))
    assert recovery.messages == recovery.messages_of_broken_chunk == len(frames)
    assert len(frames) > 100
    assert "ends inside a record" in recovery.lost[0]


@settings(max_examples=60)
@given(st.data())
def test_a_flipped_byte_costs_at_most_one_chunk_or_is_told(whole_log, tmp_path_factory, data):
    path = tmp_path_factory.mktemp("flip") / "flip.mcap"
    content = bytearray(whole_log.read_bytes())
    place = data.draw(st.integers(8, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    frames, log = read(path)
    numbers = numbers_of(frames)
    assert numbers == sorted(set(numbers))
    assert set(numbers) <= set(range(CHUNKS * CHUNK_FRAMES))
    if len(numbers) < CHUNKS * CHUNK_FRAMES - CHUNK_FRAMES:
        assert log.problems


@pytest.mark.parametrize("opcode", [0, 2, 15, 255], ids=["none", "footer", "data end", "unknown"])
def test_a_first_record_of_another_kind_costs_nothing_or_is_told(whole_log, tmp_path, opcode):
    """A footer where the header was would end the file before its first frame."""
    path = tmp_path / "flip.mcap"
    content = bytearray(whole_log.read_bytes())
    content[8] = opcode
    path.write_bytes(content)
    frames, log = read(path)
    assert numbers_of(frames) == list(range(CHUNKS * CHUNK_FRAMES)) or log.problems
    assert len(frames) >= (CHUNKS - 1) * CHUNK_FRAMES


def test_recovered_file_opens_everywhere_and_keeps_all(tmp_path):
    path, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    rows = np.zeros(5, ESTIMATES.dtype)
    rows["t_us"] = START + np.arange(5)
    with McapLog(path, documents={"car.yaml": b"name: car"}, metadata={"run": {"a": "b"}}) as log:
        log.write_frames(numbered_frames(5))
        log.write_table(ESTIMATES, rows)
        log.write_event(START, EventLevel.INFO, "x", "y")
        log.flush()
        path_size = log.size
        log.write_frames(numbered_frames(5))
    path.write_bytes(path.read_bytes()[: path_size + 30])
    seen = []
    recovery = recover(path, out, seen.append)
    assert recovery.messages == 11
    assert recovery.attachments == 1
    assert recovery.bytes_lost == 30
    assert seen[-1] == 1.0
    with out.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_summary().statistics.message_count == 11
        assert len(list(reader.iter_decoded_messages())) == 11
        assert [a.name for a in reader.iter_attachments()] == ["car.yaml"]
        assert {m.name for m in reader.iter_metadata()} == {"run", "dctorque", "recovered"}
    assert_same_frames(read(out)[0], numbered_frames(5))
    np.testing.assert_array_equal(read_table(out, ESTIMATES), rows)


def test_recover_never_overwrites(whole_log, tmp_path):
    out = tmp_path / "out.mcap"
    out.write_text("mine")
    with pytest.raises(LogWriteError, match="exists already"):
        recover(whole_log, out)
    with pytest.raises(LogWriteError, match="exists already"):
        recover(whole_log, whole_log)
    assert out.read_text() == "mine"


def test_recover_needs_an_mcap(tmp_path):
    with pytest.raises(LogReadError, match="no such file"):
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    (tmp_path / "a.mcap").write_bytes(b"x" * 100)
    with pytest.raises(LogReadError, match="is no MCAP file"):
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert not (tmp_path / "b.mcap").exists()


KILLED_WRITER = """
import signal, sys
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.pipeline.frames import Frames
log = McapLog(sys.argv[1])
frames = Frames.empty(4)
for number in range(250):
    frames.t_us[:] = number
    log.write_frames(frames)
    if number % 50 == 0:
        log.flush()
print("written", flush=True)
signal.pause()
"""


def test_kill_9_loses_at_most_what_came_after_the_last_flush(tmp_path):
    path = tmp_path / "log.mcap"
    writer = subprocess.Popen([sys.executable, "-c", KILLED_WRITER, str(path)], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    assert writer.stdout.readline() == "written\n"
    writer.send_signal(signal.SIGKILL)
    assert writer.wait() == -signal.SIGKILL
    writer.stdout.close()
    frames, log = read(path)
    flushed = np.repeat(np.arange(201), 4)
    np.testing.assert_array_equal(frames.t_us[: len(flushed)], flushed)
    assert len(log.problems) == 1
    assert "was not closed" in log.problems[0]


LIMITED_WRITER = """
import sys
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
import numpy as np
from dctorque_can.logs.errors import LogWriteError
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.pipeline.frames import Frames
frames = Frames.empty(100)
with McapLog(sys.argv[1], compression="") as log:
    for i in range(1000):
        frames.t_us[:] = i
        try:
            log.write_frames(frames)
            log.flush()
        except LogWriteError as error:
            print(i)
            print(error)
            break
    try:
        log.write_frames(frames)
        log.flush()
    except LogWriteError as error:
        print(error)
"""


def test_a_full_disk_is_one_clear_error_and_the_log_stays_readable(tmp_path):
    path = tmp_path / "log.mcap"
    source = LIMITED_WRITER.format(limit=100_000)
    done = subprocess.run([sys.executable, "-c", source, str(path)], capture_output=True, text=True, check=True)
    batches, error, second = done.stdout.splitlines()
    assert f"{path}: writing failed after" in error
    assert "File too large" in error
    assert "an earlier write failed" in second
    frames, log = read(path)
    assert len(frames) in (100 * int(batches), 100 * int(batches) + 100)
    assert len(log.problems) == 1
    assert path.stat().st_size == 100_000


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_dev_full():
    with pytest.raises(LogWriteError, match="No space left on device"):
        McapLog(Path("/dev/full"))


def test_a_log_that_can_not_be_created(tmp_path):
    with pytest.raises(LogWriteError, match=r"can not be created: No such file or directory"):
        McapLog(tmp_path / "missing" / "log.mcap")
    with pytest.raises(LogWriteError, match="can not be created: Is a directory"):
        McapLog(tmp_path)
    (tmp_path / "old.mcap").write_text("old")
    with pytest.raises(LogWriteError, match="exists already"):
        McapLog(tmp_path / "old.mcap", overwrite=False)
    log = McapLog(tmp_path / "new.mcap")
    log.close()
    log.close()
    with pytest.raises(LogWriteError, match="is closed"):
        log.write_frames(numbered_frames(1))
