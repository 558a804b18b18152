"""``dctorque status`` against a real ``dctorque run``."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from dctorque_can.report.status_page import WIDTH, status_page
from dctorque_can.resources import shipped_config

HANG_S = 900


@pytest.fixture
def service(command: list[str], environment: dict[str, str], tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A service that runs, with a socket `s`."""
    car = tmp_path / "car.yaml"
    dbc = shipped_config("paper_car").parents[1] / "dbc" / "demo_car.dbc"
    car.write_text(shipped_config("paper_car").read_text().replace("../dbc/demo_car.dbc", str(dbc)))
    process = subprocess.Popen(
        [*command, "run", "car.yaml", "-i", "virtual", "--channel", "quiet", "--status", "s"],
        cwd=tmp_path,
        env=environment | {"RUNTIME_DIRECTORY": "/nowhere"},
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(process, "estimating on")
    yield process
    process.kill()
    process.communicate(timeout=HANG_S)


def wait_for(process: subprocess.Popen[str], text: str) -> None:
    assert process.stderr is not None
    while text not in (line := process.stderr.readline()):
        assert line


def told(dctorque, *arguments: str):  # type: ignore[no-untyped-def]
    """Return the outcome as soon as the service has a status."""
    while (outcome := dctorque("status", *arguments)).code == 1 and "no status yet" in outcome.err:
        time.sleep(0.05)
    return outcome


def test_it_shows_a_service_in_80_columns_and_as_one_object(dctorque, service, tmp_path: Path) -> None:
    outcome = told(dctorque, "-s", "s")
    assert outcome.code == 0, outcome.err
    lines = outcome.out.splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert lines[0].startswith("service   paper car: no frame yet")
    assert any(line.startswith("messages  EngineData never") for line in lines)
    outcome = told(dctorque, "-s", "s", "--json")
    status = json.loads(outcome.out)
    assert status["pid"] == service.pid
    assert status["name"] == "paper car"


def test_a_service_that_hangs_is_told_with_code_3(dctorque, service, monkeypatch: pytest.MonkeyPatch) -> None:
    told(dctorque, "-s", "s")
    monkeypatch.setattr("dctorque_can.cli.status.STALE_S", 0.2)
    monkeypatch.setattr("dctorque_can.report.status_page.HANGS_S", 0.2)
    os.kill(service.pid, signal.SIGSTOP)
    time.sleep(0.3)
    outcome = dctorque("status", "-s", "s")
    os.kill(service.pid, signal.SIGCONT)
    assert outcome.code == 3
    assert outcome.out.startswith("HANGS")


def test_a_service_reads_its_file_anew_and_its_socket_goes_with_it(
    dctorque, service: subprocess.Popen[str], tmp_path: Path
) -> None:
    told(dctorque, "-s", "s")
    car = tmp_path / "car.yaml"
    car.write_text(car.read_text().replace("flush_ms: 200", "flush_ms: 2000"))
    os.kill(service.pid, signal.SIGHUP)
    wait_for(service, "read anew: logging.flush_ms")
    wait_for(service, "logging to")
    assert len(list((tmp_path / "logs").glob("*.mcap"))) == 2
    car.write_text(car.read_text().replace("flush_ms", "flash_ms"))
    os.kill(service.pid, signal.SIGHUP)
    wait_for(service, "did you mean flush_ms")
    while json.loads(told(dctorque, "-s", "s", "--json").out)["configuration"]["reloads"]["refused"] != 1:
        time.sleep(0.05)
    os.kill(service.pid, signal.SIGTERM)
    service.communicate(timeout=HANG_S)
    assert service.returncode == 0
    assert not (tmp_path / "s").exists()
    assert dctorque("status", "-s", "s").code == 1


def test_a_name_and_a_socket_contradict_each_other(dctorque) -> None:
    assert dctorque("status", "mycar", "-s", "s").code == 2
    outcome = dctorque("status", "../mycar")
    assert outcome.code == 1
    assert "the name of an instance" in outcome.err


def test_watching_ends_with_the_service(dctorque, service: subprocess.Popen[str]) -> None:
    told(dctorque, "-s", "s")
    service.kill()
    outcome = dctorque("status", "-s", "s", "--watch", "0.2", "--json")
    assert outcome.code == 1
    assert all(json.loads(line)["pid"] == service.pid for line in outcome.out.splitlines())


def test_no_word_of_a_service_is_a_command_to_the_terminal(
    dctorque, service, monkeypatch: pytest.MonkeyPatch
) -> None:
    status = json.loads(told(dctorque, "-s", "s", "--json").out)
    hostile = status | {"name": "\x1b]0;owned\x07", "state": "a\nb\rc\u202e\x9b"}
    assert "\x1b" in "".join(status_page(hostile))
    monkeypatch.setattr("dctorque_can.daemon.status.client.read_status", lambda path: hostile)
    out = dctorque("status", "-s", "s").out
    assert "\\x1b]0;owned" in out
    assert all(line.isprintable() for line in out.splitlines())
