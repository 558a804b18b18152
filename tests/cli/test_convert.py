"""``dctorque convert``: the same frames in another format, and what that cannot keep."""

import json
from pathlib import Path

import numpy as np
import pytest

from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

START = 1_700_000_000_000_000
KINDS = (".mcap", ".blf", ".asc", ".log", ".trc", ".csv")


def some_frames() -> Frames:
    frames = Frames.empty(500)
    frames.t_us[:] = START + np.arange(500) * 1000
    frames.can_id[:] = 0x100 + np.arange(500) % 3
    frames.can_id[::7] |= EXTENDED_ID
    frames.length[:] = 8
    frames.data[:] = np.random.default_rng(3).integers(0, 256, (500, 8))
    return frames


def read(path: Path) -> Frames:
    with open_log(path) as log:
        return Frames.concatenate(log.dated_frames())


@pytest.mark.parametrize("source", KINDS)
@pytest.mark.parametrize("target", KINDS)
def test_from_every_format_to_every_format(dctorque, tmp_path: Path, source: str, target: str) -> None:
    frames = some_frames()
    write_frames(tmp_path / f"a{source}", frames)
    outcome = dctorque("convert", f"a{source}", f"b{target}", "--json")
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out) == {"output": f"b{target}", "frames": 500, "problems": [], "lost": []}
    found = read(tmp_path / f"b{target}")
    np.testing.assert_array_equal(np.diff(found.t_us), 1000)
    np.testing.assert_array_equal(found.can_id, frames.can_id)
    np.testing.assert_array_equal(found.data, frames.data)
    if ".trc" not in (source, target):  # which begins at 0 in some of its versions
        assert abs(int(found.t_us[0]) - START) <= 1000


def test_a_date_of_few_milliseconds_is_kept(tmp_path: Path) -> None:
    """python-can writes 5 ms as ".5"."""
    frames = some_frames()
    frames.t_us[:] += 5000
    write_frames(tmp_path / "a.asc", frames)
    assert int(read(tmp_path / "a.asc").t_us[0]) == START + 5000


def test_what_a_format_cannot_keep_is_told(dctorque, tmp_path: Path) -> None:
    frames = some_frames()
    frames.flags[0] = FrameFlag.FD
    frames.flags[1] = FrameFlag.REMOTE
    frames.flags[2:4] = FrameFlag.ERROR
    write_frames(tmp_path / "a.mcap", frames)
    told = dctorque("convert", "a.mcap", "b.trc")
    assert told.code == 3
    assert "4 CAN FD, remote or error frames are left out: TRC cannot hold them" in told.err
    assert len(read(tmp_path / "b.trc")) == 496
    told = dctorque("convert", "a.mcap", "b.csv")
    assert "1 frames: CSV does not keep that they are CAN FD" in told.err
    frames = some_frames()
    frames.t_us[10] -= 5000
    write_frames(tmp_path / "c.mcap", frames)
    told = dctorque("convert", "c.mcap", "c.log")
    assert told.code == 3
    assert "1 frames stand behind frames of a later time: LOG gives them that time" in told.err
    assert dctorque("convert", "c.mcap", "d.mcap").code == 0
    told = dctorque("convert", "a.mcap", "b.blf")
    assert told.code == 0, told.err


def test_what_cannot_be_read_or_written_is_told(dctorque, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,id,data\n0.1,123,00\n0.2,xyz,00\n")
    told = dctorque("convert", "a.csv", "b.mcap")
    assert told.code == 3
    assert "1 lines can not be read" in told.err
    assert "1 frames in b.mcap" in told.err
    assert dctorque("convert", "a.csv", "b.mcap").code == 1
    assert dctorque("convert", "a.csv", "b.mcap", "--force").code == 3
    wrong = dctorque("convert", "a.csv", "b.txt")
    assert wrong.code == 1
    assert "known are" in wrong.err
    empty = dctorque("simulate", "-o", "drive.mcap", "--duration", 1)
    assert empty.code == 0
