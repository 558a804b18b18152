"""The `.mcap` suffix in python-can: classes, entry points, and the command line tools of python-can."""

import subprocess
import sys

import can
import pytest

from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.plugin import McapReader, McapWriter
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

from ..frames_strategy import assert_same_frames, frame, frames_of

START = 1_700_000_000_000_000
FRAMES = frames_of(
    [
        frame(START, 0x123, b"\x01\x02"),
        frame(START + 1_500_000, 0x1ABCDEF | int(EXTENDED_ID), bytes(8), FrameFlag.TRANSMITTED, 1),
        frame(START + 1_500_001, 0x10, bytes(range(64)), FrameFlag.FD | FrameFlag.ERROR_STATE),
        frame(START + 1_600_000, 0x7FF, b"", FrameFlag.REMOTE, length=4),
    ]
)


def test_python_can_finds_reader_and_writer_by_suffix(tmp_path):
    path = tmp_path / "x.mcap"
    with can.Logger(path) as writer:
        assert isinstance(writer, McapWriter)
        for i in range(len(FRAMES)):
            writer.on_message_received(message_from_frame(FRAMES, i))
        assert writer.file_size() > 0
    with can.LogReader(path) as reader:
        assert isinstance(reader, McapReader)
        messages = list(reader)
    assert len(messages) == len(FRAMES)
    for i, message in enumerate(messages):
        assert message.equals(message_from_frame(FRAMES, i), timestamp_delta=0.0)
    assert_same_frames(Frames.concatenate(open_log(path).frames()), FRAMES)


def test_can_logconvert(tmp_path):
    blf, mcap, back = tmp_path / "x.blf", tmp_path / "x.mcap", tmp_path / "back.blf"
    write_frames(blf, FRAMES)
    for source, target in ((blf, mcap), (mcap, back)):
        subprocess.run(
            [sys.executable, "-m", "can.logconvert", str(source), str(target)], check=True, capture_output=True
        )
    for path in (mcap, back):
        assert_same_frames(Frames.concatenate(open_log(path).frames()), FRAMES)


def test_sent_frames_are_marked_and_are_no_reception(tmp_path):
    path = tmp_path / "x.mcap"
    write_frames(path, frames_of([frame(START, 0x6F0, b"\1", FrameFlag.SENT)]))
    (message,) = McapReader(path)
    assert not message.is_rx


def test_messages_are_flushed_once_per_second_of_their_time(tmp_path):
    path = tmp_path / "x.mcap"
    writer = McapWriter(path)
    for i in range(30):
        writer.on_message_received(can.Message(timestamp=START / 1e6 + 0.1 * i, arbitration_id=1))
    on_disk = open_log(path)
    assert sum(map(len, on_disk.frames())) >= 20
    writer.stop()
    assert sum(map(len, open_log(path).frames())) == 30


def test_bad_use(tmp_path):
    with pytest.raises(ValueError, match="can not be appended to"):
        can.Logger(tmp_path / "x.mcap", append=True)
    with pytest.raises(LogReadError, match="no such file"):
        can.LogReader(tmp_path / "missing.mcap")
