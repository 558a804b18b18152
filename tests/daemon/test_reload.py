"""The vehicle file read anew in a running service: what takes effect, what is refused, and what the logs say."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import can
import pytest
from mcap.reader import make_reader

from dctorque_can.config.changes import changed_keys, needs_restart
from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.reload import Reloader
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES
from dctorque_can.logs.messages import message_from_frame
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.replay import ReplayContent, ReplayTargets, replay_logs
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.resources import shipped_config, shipped_dbc

from .test_service import Live, start

Connect = Callable[[], can.BusABC]
PAPER = shipped_config("paper_car").read_text()


class File:
    """A vehicle file that somebody edits, with its DBC."""

    def __init__(self, folder: Path, channel: str) -> None:
        self.dbc = folder / "demo_car.dbc"
        self.dbc.write_bytes(shipped_dbc("demo_car").read_bytes())
        self.path = folder / "mycar.yaml"
        self.text = PAPER.replace("../dbc/demo_car.dbc", str(self.dbc))
        self.edit("{directory: logs, flush_ms: 200}", f"{{directory: {folder / 'logs'}, flush_ms: 200}}")
        self._channel = channel

    def edit(self, old: str, new: str) -> None:
        assert self.text.count(old) == 1, old
        self.text = self.text.replace(old, new)
        self.path.write_text(self.text)

    def read(self) -> Config:
        return load_config(self.path, {"can.interface": "virtual", "can.channel": self._channel})


@pytest.fixture
def file(tmp_path: Path, config: Config) -> File:
    return File(tmp_path, str(config.can.channel))


def reloaded(file: File, now: Config, told: list[str]) -> Config | None:
    """Return what comes of one wish."""
    reloader = Reloader(file.read, lambda is_error, text: told.append(text))
    reloader.ask()
    found = None
    while not sum(reloader.outcomes.values()):
        found = reloader.look(now)
    return found


def test_what_may_change_takes_effect(file: File) -> None:
    now, told = file.read(), []
    file.edit("flush_ms: 200", "flush_ms: 300, keep_mb: 5000")
    file.edit("{enabled: true}", "{enabled: true, foreign_silence_s: 9}")
    new = reloaded(file, now, told)
    assert new is not None
    assert (new.logging.flush_ms, new.output.foreign_silence_s) == (300.0, 9.0)
    assert told == [
        f"{file.path}: read anew: logging.flush_ms, logging.keep_mb, output.foreign_silence_s; "
        "a new log begins with it"
    ]


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("engine_inertia_kgm2: 0.2 ", "engine_inertia_kgm2: 0.3 ", "vehicle.engine_inertia_kgm2"),
        ("{enabled: true}", "{enabled: false}", "output.enabled"),
        ("flush_ms: 200", "flush_ms: 200, enabled: false", "logging.enabled"),
        ("name: paper car", "name: your car", "name"),
        ("name: paper car", "name: paper car\nstatus: {metrics: '127.0.0.1:9642'}", "status.metrics"),
    ],
)
def test_what_needs_a_restart_is_refused_with_all_that_stands_beside_it(
    file: File, old: str, new: str, key: str
) -> None:
    now, told = file.read(), []
    file.edit(old, new)
    file.edit("flush_ms: 200", "flush_ms: 300")
    assert reloaded(file, now, told) is None
    assert told == [f"{file.path}: needs a restart to take effect: {key}", "the configuration stays as it was"]


def test_another_dbc_is_refused(file: File) -> None:
    now, told = file.read(), []
    file.dbc.write_bytes(file.dbc.read_bytes() + b"\n")
    assert reloaded(file, now, told) is None
    assert told[0] == f"{file.path}: needs a restart to take effect: databases: demo_car.dbc"


def test_every_mistake_of_a_wrong_file_is_told(file: File) -> None:
    now, told = file.read(), []
    file.edit("flush_ms: 200", "flush_ms: 1, rotate_mb: many")
    assert reloaded(file, now, told) is None
    assert len(told) == 3
    assert "logging.flush_ms = 1" in told[0]
    assert "logging.rotate_mb = many" in told[1]
    file.path.unlink()
    assert reloaded(file, now, told) is None
    assert "No such file" in told[3]
    file.path.write_bytes(b"\xff\xfe{{{")
    assert reloaded(file, now, told) is None
    assert "UTF-8" in told[5]


def test_a_file_that_is_as_it_was_begins_nothing(file: File) -> None:
    told: list[str] = []
    assert reloaded(file, file.read(), told) is None
    assert told == [f"{file.path}: has not changed"]


def test_a_reader_that_fails_otherwise_stops_nothing(file: File) -> None:
    def read() -> Config:
        raise ZeroDivisionError("found by nobody yet")

    told: list[str] = []
    reloader = Reloader(read, lambda is_error, text: told.append(text))
    reloader.ask()
    while not reloader.outcomes["refused"]:
        assert reloader.look(file.read()) is None
    assert told[0] == "unexpected ZeroDivisionError: found by nobody yet"


def test_changes_are_found_key_by_key(file: File) -> None:
    before = file.read()
    assert changed_keys(before, before) == []
    file.edit("flush_ms: 200", "flush_ms: 200.0")  # the same number in other words is a change of the text alone
    assert changed_keys(before, file.read()) == ["logging.flush_ms"]
    assert not needs_restart("logging.flush_ms")
    assert not needs_restart("state.save_s")
    for key in (
        "logging.enabled",
        "logging.frames",
        "logging_x",
        "state.directory",
        "can.channel",
        "estimator.period_us",
    ):
        assert needs_restart(key)


def fed(live: Live, connect: Connect, drive: SimulatedDrive, part: slice) -> None:
    """Send a part of a drive and wait until all of it is taken."""
    before = live.service.received
    frames = drive.frames[part]
    with connect() as bus:
        for i in range(len(frames)):
            bus.send(message_from_frame(frames, i))
    live.wait_for(before + len(frames))


def wait_for_line(live: Live, pattern: str) -> None:
    while not any(re.search(pattern, line) for line in live.told):
        assert live.thread.is_alive()


def test_a_reload_begins_a_log_with_the_new_file_that_replays_alone(
    file: File, connect: Connect, drive: SimulatedDrive, tmp_path: Path
) -> None:
    config = file.read()
    live = start(config, connect, tmp_path / "logs" / "first.mcap", reread=partial(file.read))
    fed(live, connect, drive, slice(0, 1000))
    file.edit("flush_ms: 200", "flush_ms: 300, signals: true")
    live.service.reload()
    wait_for_line(live, "read anew: logging.flush_ms, logging.signals; a new log")
    fed(live, connect, drive, slice(1000, 2000))
    file.edit("flush_ms: 300", "flash_ms: 300")
    live.service.reload()
    wait_for_line(live, "stays as it was")
    fed(live, connect, drive, slice(2000, 2400))
    summary = live.stop()
    assert summary.complete
    assert summary.log is not None
    assert len(summary.log.paths) == 2
    flush_ms = []
    decoded = []
    for path in summary.log.paths:
        with path.open("rb") as stream:
            summary_of = make_reader(stream).get_summary()
            assert summary_of is not None
            decoded.append(any(each.topic.startswith("/signals/") for each in summary_of.channels.values()))
        with open_log(path) as log:
            text = log.documents["mycar.yaml"].decode()
            flush_ms.append(re.search(r"flush_ms: (\d+)", text)[1])  # type: ignore[index]
            own = load_config_of(log.documents)
            replay_logs([log], own, ReplayTargets(tmp_path / "again.mcap"), ReplayContent(), lambda fraction: None)
        live_rows, again = read_table(path, ESTIMATES), read_table(tmp_path / "again.mcap", ESTIMATES)
        assert len(live_rows) > 100
        assert live_rows.tobytes() == again.tobytes()
        (tmp_path / "again.mcap").unlink()
    assert flush_ms == ["200", "300"]
    assert decoded == [False, True]


def load_config_of(documents: dict[str, bytes]) -> Config:
    from dctorque_can.config.load import load_documents

    return load_documents({name: content for name, content in documents.items() if not name.endswith(".state")})
