"""A car that nobody has, a drive of it, and what its owner knows."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from dctorque_can.config.load import Config, load_config
from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car, write_log
from dctorque_can.study.invented_car import invent_car
from tests.cli.conftest import dctorque

__all__ = ["dctorque"]

SEED = 3
SECONDS = 240.0


@dataclass(frozen=True)
class Owned:
    """Files of one car: the truth, what its owner knows, and a recorded drive."""

    truth: Config
    owners: Path
    log: Path


def without_delays(value: Any) -> Any:
    """Return a part of a vehicle file without its delays."""
    if isinstance(value, dict):
        return {key: without_delays(item) for key, item in value.items() if key != "delay_ms"}
    return [without_delays(item) for item in value] if isinstance(value, list) else value


@pytest.fixture(scope="session")
def owned(tmp_path_factory: pytest.TempPathFactory) -> Owned:
    """Return a car whose owner knows its ratios and its class, and no delay."""
    folder = tmp_path_factory.mktemp("owned")
    car = invent_car(SEED)
    for name, content in car.documents.items():
        (folder / name).write_bytes(content)
    truth = load_config(folder / "car.yaml")
    log = folder / "drive.mcap"
    drive = simulate_car(truth, DriveName.MIXED, ProfileName.PRODUCTION, 31, SECONDS)
    write_log(truth, drive, log)
    known = without_delays(car.vehicle_file)
    gears = {
        n: {key: gear[key] for key in ("shaft", "ratio", "final_drive")}
        for n, gear in car.vehicle_file["vehicle"]["gears"].items()
    }
    known["vehicle"] = {"class": car.class_name, "gears": gears, "driven_axle": "front"}
    owners = folder / "mine.yaml"
    owners.write_text(yaml.safe_dump(known, sort_keys=False))
    return Owned(truth, owners, log)
