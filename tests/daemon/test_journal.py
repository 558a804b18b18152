"""How serious a line is, for the journal alone."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from dctorque_can.daemon import journal
from dctorque_can.daemon.journal import Priority, is_journal, line


@pytest.fixture(autouse=True)
def _asked_anew() -> Iterator[None]:
    is_journal.cache_clear()
    yield
    is_journal.cache_clear()


def test_lines_for_the_journal_say_how_serious_they_are(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with (tmp_path / "journal").open("wb") as file:
        status = os.fstat(file.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino}")
        assert is_journal(file.fileno())
        monkeypatch.setattr(journal, "is_journal", lambda: True)
        assert line(Priority.ERROR, "one\ntwo") == "<3>one\n<3>two"
        assert line(Priority.INFO, "a") == "<6>a"


@pytest.mark.parametrize("told", ["", "1:2", "nonsense"])
def test_elsewhere_lines_are_as_they_were(monkeypatch: pytest.MonkeyPatch, told: str) -> None:
    """Also where the service's output goes to a file and the variable is that of whoever started it."""
    monkeypatch.setenv("JOURNAL_STREAM", told)
    assert line(Priority.ERROR, "one\ntwo") == "one\ntwo"


def test_the_command_line_tells_the_journal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from dctorque_can.cli import console

    monkeypatch.setattr(journal, "is_journal", lambda: True)
    monkeypatch.setattr(console, "is_journal", lambda: True)
    console.say("a [b]")
    console.warn("c")
    console.fail("d\ne")
    assert capsys.readouterr().err == "<6>a [b]\n<4>c\n<3>d\n<3>e\n"
