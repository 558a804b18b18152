"""Logs with flipped, missing and doubled bytes: never an exception, and nothing made up of nothing."""

import gc
import random

import numpy as np
import pytest

from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.recover import recover
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import FrameFlag, Frames

N = 200


def some_frames(fd):
    frames = Frames.empty(N, 64 if fd else 8)
    frames.t_us[:] = 1_700_000_000_000_000 + np.arange(N) * 1000
    frames.can_id[:] = 0x100 + np.arange(N) % 7
    frames.length[:] = 8
    frames.data[:, :8] = np.random.default_rng(0).integers(0, 256, (N, 8))
    if fd:
        frames.length[::10] = 64
        frames.flags[::10] = FrameFlag.FD
    return frames


def mutilated(content, rng):
    damaged = bytearray(content)
    for _ in range(rng.choice([1, 2, 5, 30])):
        kind, place = rng.random(), rng.randrange(len(damaged))
        if kind < 0.6:
            damaged[place] = rng.choice([0, 255, 10, 13, 32, 48, 35, rng.randrange(256)])
        elif kind < 0.8:
            del damaged[place : place + rng.randrange(1, 60)]
        elif kind < 0.9:
            damaged[place:place] = damaged[place // 2 : place // 2 + rng.randrange(1, 50)]
        else:
            del damaged[place:]
        if not damaged:
            break
    return bytes(damaged)


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log", ".mcap", ".csv", ".trc"])
def test_mutilated_files_are_read_as_far_as_they_go(tmp_path, suffix, capfd):
    path, out = tmp_path / f"x{suffix}", tmp_path / "out.mcap"
    write_frames(path, some_frames(suffix not in (".csv", ".trc")))
    content = path.read_bytes()
    rng = random.Random(suffix)
    opened = 0
    for _ in range(100):
        path.write_bytes(mutilated(content, rng))
        try:
            log = open_log(path)
        except LogReadError:
            continue
        frames = Frames.concatenate(log.frames())
        assert len(frames) <= 2 * N
        assert log.fraction == 1.0
        assert all(line.startswith(str(path)) for line in log.problems)
        if suffix == ".mcap":
            out.unlink(missing_ok=True)
            recovery = recover(path, out)
            assert recovery.messages >= len(frames)
            assert len(Frames.concatenate(open_log(out).frames())) >= len(frames)
        opened += 1
    assert opened > 50
    assert capfd.readouterr().err == ""


def test_mutilated_mf4_gives_frames_or_one_refusal_and_never_a_traceback(tmp_path, capfd):
    """An object that asammdf leaves half made would be told by pytest when it is collected."""
    pytest.importorskip("asammdf")
    path = tmp_path / "x.mf4"
    write_frames(path, some_frames(fd=True))
    content = path.read_bytes()
    rng = random.Random(1)
    refused = {"cut": 0, "corrupt": 0}
    for share in (0.2, 0.6, 0.99, 0.999):
        path.write_bytes(content[: int(share * len(content))])
        refused["cut"] += not read_or_refuse(path)
    for _ in range(40):
        damaged = bytearray(content)
        place = rng.randrange(8, len(content) - 40)
        damaged[place : place + 40] = rng.randbytes(40)
        path.write_bytes(damaged)
        refused["corrupt"] += not read_or_refuse(path)
    gc.collect()
    assert refused["cut"] == 4
    assert 5 < refused["corrupt"] < 40
    assert capfd.readouterr().err == ""


def test_mf4_with_a_channel_beyond_its_records_is_refused(tmp_path):
    """Found by tools/fuzz: asammdf's machine code reads at a channel's offset unasked."""
    pytest.importorskip("asammdf")
    path = tmp_path / "x.mf4"
    write_frames(path, some_frames(fd=False))
    content = bytearray(path.read_bytes())
    at = content.index(b"##CN")  # its byte offset stands behind 24 bytes of head, 8 links and 4 bytes
    assert int.from_bytes(content[at + 16 : at + 24], "little") == 8
    content[at + 24 + 8 * 8 + 4 : at + 24 + 8 * 8 + 8] = (65_008).to_bytes(4, "little")
    path.write_bytes(content)
    with pytest.raises(
        LogReadError, match=r"the channel '\S+' of group \d ends at byte 650\d\d of records of \d+ bytes"
    ):
        open_log(path)


@pytest.mark.parametrize("kind", [b"##DG", b"##CG", b"##CN"])
def test_mf4_whose_blocks_follow_each_other_in_a_ring_is_refused(tmp_path, kind):
    """Found by tools/fuzz: asammdf goes round for ever."""
    pytest.importorskip("asammdf")
    path = tmp_path / "x.mf4"
    write_frames(path, some_frames(fd=False))
    content = bytearray(path.read_bytes())
    at = content.index(kind)
    content[at + 24 : at + 32] = at.to_bytes(8, "little")  # its next one is itself
    path.write_bytes(content)
    with pytest.raises(LogReadError, match=rf"two links lead to the block at byte {at}"):
        open_log(path)


def read_or_refuse(path) -> bool:
    try:
        with open_log(path) as log:
            frames = Frames.concatenate(log.frames())
    except LogReadError as error:
        lines, read = [str(error)], False
    else:
        lines, read = log.problems, True
        assert len(frames) <= N
    for line in lines:
        assert line.startswith(str(path))
        assert "\n" not in line
        assert "Traceback" not in line
    return read
