"""What a running service tells of itself, and what Prometheus makes of it."""

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import can
import pytest
from prometheus_client.parser import text_string_to_metric_families

from dctorque_can import __version__
from dctorque_can.config.edges import StatusSection
from dctorque_can.config.identity import vehicle_digest
from dctorque_can.config.load import Config
from dctorque_can.daemon.status.client import read_status
from dctorque_can.daemon.status.metrics import metrics_text
from dctorque_can.daemon.status.process import StatusPlaces, places_for
from dctorque_can.errors import DctorqueError
from dctorque_can.offline.simulated_car import SimulatedDrive

from .test_service import Live, send, start

Connect = Callable[[], can.BusABC]


@pytest.fixture
def live(config: Config, connect: Connect, folder: Path, tmp_path: Path) -> Live:
    return start(config, connect, folder / "live.mcap", places=StatusPlaces(tmp_path / "status.sock"))


def status_when(path: Path, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    while True:
        with suppress(DctorqueError):  # before the first one
            status = read_status(path, 600.0)
            if holds(status):
                return status


def test_the_status_agrees_with_the_summary(
    live: Live, config: Config, connect: Connect, drive: SimulatedDrive, tmp_path: Path
) -> None:
    path = tmp_path / "status.sock"
    send(connect, drive.frames)
    live.wait_for(len(drive.frames))
    status = status_when(path, lambda status: status["frames"] == len(drive.frames))
    summary = live.stop().as_json()
    for name in ("frames", "estimates", "valid_estimates", "published", "status_time", "buses", "refused_ids"):
        assert status[name] == summary[name], name
    for name in ("not_available", "bad_crc", "bad_counter", "timeouts", "gap_resets", "findings"):
        assert status["health"][name] == summary["health"][name], name
    assert status["output"]["cycles"].keys() == summary["output"]["cycles"].keys()
    assert status["state"].startswith("estimating")
    assert status["version"] == __version__
    assert status["configuration"]["vehicle_digest"] == vehicle_digest(config)
    assert status["log"]["opened"] == 1
    assert Path(status["log"]["files"][0]["path"]) == Path(summary["log"]["paths"][0])
    assert summary["log"]["sizes"] == [Path(summary["log"]["paths"][0]).stat().st_size]
    mapped = {signal.message for each in config.inputs for signal in each.signals}
    assert {message["name"] for message in status["messages"]} == mapped
    assert all(0.0 <= message["age_s"] < 600.0 for message in status["messages"])
    assert not path.exists()  # it ends with the service
    check_metrics(status)


def check_metrics(status: dict[str, Any]) -> None:
    text = metrics_text(status)
    samples = {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }
    assert len(samples) == sum(not line.startswith("#") for line in text.splitlines())
    assert samples["dctorque_up",] == 1
    bus = status["buses"][0]
    assert samples["dctorque_frames_received_total", bus["name"]] == bus["received"]
    assert samples["dctorque_frames_sent_total", bus["name"]] == bus["sent"]
    assert samples["dctorque_log_frames_written_total",] == status["log"]["written"]
    assert samples["dctorque_status_time_ratio", "clutch1_valid"] == status["status_time"]["clutch1_valid"]
    for message in status["messages"]:
        assert samples["dctorque_message_age_seconds", message["name"], message["id"], ""] == message["age_s"]
    assert samples["dctorque_latency_seconds_count",] == status["latency"]["count"]
    families = [line.split()[2] for line in text.splitlines() if line.startswith("# TYPE")]
    assert len(families) == len(set(families))  # each stands together


def test_a_bus_that_says_nothing_has_a_status_too(live: Live, tmp_path: Path) -> None:
    status = status_when(tmp_path / "status.sock", lambda status: True)
    assert status["state"] == "no frame yet"
    assert {message["age_s"] for message in status["messages"]} == {None}
    assert status["latency"]["p99_ms"] is None
    live.stop()
    assert "dctorque_message_age_seconds" not in metrics_text(status)
    json.dumps(status, allow_nan=False)


def test_names_of_the_vehicle_file_cannot_break_the_metrics(live: Live, tmp_path: Path) -> None:
    status = status_when(tmp_path / "status.sock", lambda status: True)
    live.stop()
    name = 'a "car"\\\nup 2'
    (info,) = [
        family
        for family in text_string_to_metric_families(metrics_text(status | {"name": name}))
        if family.name == "dctorque_info"
    ]
    assert info.samples[0].labels["name"] == name


def test_where_the_status_is(monkeypatch: pytest.MonkeyPatch, config: Config) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    assert places_for(config.status) is None
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/run/dctorque/mycar:/run/other")
    assert places_for(config.status) == StatusPlaces(Path("/run/dctorque/mycar/status.sock"))
    named = StatusSection(socket="/run/named", metrics="[::1]:9642")
    assert places_for(named) == StatusPlaces(Path("/run/named"), ("::1", 9642))
    assert places_for(named, Path("given")) == StatusPlaces(Path("given"), ("::1", 9642))


def test_a_service_whose_socket_is_taken_does_not_start(
    live: Live, config: Config, connect: Connect, tmp_path: Path, folder: Path
) -> None:
    with pytest.raises(DctorqueError, match="another service serves there"):
        start(config, connect, folder / "second.mcap", places=StatusPlaces(tmp_path / "status.sock"))
    assert status_when(tmp_path / "status.sock", lambda status: True)["pid"]
    live.stop()
