from datetime import UTC, datetime
from pathlib import Path

from dctorque_can.config.load import Config
from dctorque_can.daemon.log.plan import LogFolder, LogPlan, plan_for

NOON = datetime(2026, 5, 4, 12, 0, 0, tzinfo=UTC)


def test_names_tell_car_and_time_and_never_repeat(tmp_path: Path) -> None:
    folder = LogFolder(tmp_path, "car")
    first = folder.next_path(0, NOON)
    first.touch()
    second = folder.next_path(1, NOON)
    assert first.name == "car_20260504T120000Z.mcap"
    assert second.name == "car_20260504T120000Z_2.mcap"


def test_an_exact_path_is_used_once(tmp_path: Path) -> None:
    folder = LogFolder(tmp_path, "drive", first=tmp_path / "drive.mcap")
    assert folder.next_path(0, NOON) == tmp_path / "drive.mcap"
    assert folder.next_path(1, NOON).name == "drive_20260504T120000Z.mcap"


def test_a_name_that_leads_nowhere_is_not_used(tmp_path: Path) -> None:
    """Or the log would be written to wherever the link points."""
    (tmp_path / "car_20260504T120000Z.mcap").symlink_to(tmp_path / "nowhere")
    assert LogFolder(tmp_path, "car").next_path(0, NOON).name == "car_20260504T120000Z_2.mcap"


def test_a_plan_survives_the_pipe(config: Config, tmp_path: Path) -> None:
    plan = plan_for(config, tmp_path / "x.mcap")
    assert LogPlan.from_json(plan.as_json()) == plan
    assert plan.flush_s == 0.2
    assert plan.metadata["bus"]["interface"] == "virtual"
