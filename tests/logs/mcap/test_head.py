"""The metadata at the head of a log: also of a torn one, and of nothing that is no log."""

import os
from pathlib import Path

import pytest
from mcap.writer import Writer

from dctorque_can.logs.mcap.head import first_metadata
from dctorque_can.logs.mcap.writer import McapLog

WORDS = {"vehicle": "car", "number": "7"}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "x.mcap"
    documents = {"car.yaml": bytes(1 << 17)}
    with McapLog(path, documents=documents, metadata={"service": WORDS, "bus": {"channel": "can0"}}) as log:
        log.sync()
    return path


def test_it_is_read_from_a_whole_log_and_from_every_torn_one_that_has_it(log: Path, tmp_path: Path) -> None:
    assert first_metadata(log) == ("service", WORDS)
    whole, torn = log.read_bytes(), tmp_path / "torn.mcap"
    known = []
    for size in range(400):
        torn.write_bytes(whole[:size])
        known.append(first_metadata(torn) is not None)
    assert known == sorted(known)
    assert known.index(True) < 200
    torn.write_bytes(whole[:200] + bytes(5000))  # what a power cut leaves
    assert first_metadata(torn) == ("service", WORDS)


def test_what_is_no_log_of_ours_has_none(log: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    with other.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    assert first_metadata(other) is None
    for content in (b"", b"\x89MCAP0\r\n", bytes(1000), os.urandom(1000), log.read_bytes()[:8] + b"\xff" * 100):
        other.write_bytes(content)
        assert first_metadata(other) is None


def test_links_directories_and_pipes_are_not_opened(log: Path, tmp_path: Path) -> None:
    link, folder, pipe = tmp_path / "link.mcap", tmp_path / "folder.mcap", tmp_path / "pipe.mcap"
    link.symlink_to(log)
    folder.mkdir()
    os.mkfifo(pipe)
    assert [first_metadata(path) for path in (link, folder, pipe)] == [None] * 3
    with pytest.raises(FileNotFoundError):
        first_metadata(tmp_path / "nothing.mcap")
