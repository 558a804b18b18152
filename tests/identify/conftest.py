"""A car that nobody has, a drive of it, and what its owner knows."""

from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from dctorque_can.config.load import Config, load_config
from dctorque_can.evidence.moments import Moments, moments
from dctorque_can.evidence.series import decoded, read_frames
from dctorque_can.logs.reader import open_log
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
    owners = folder / "mine.yaml"
    owners.write_text(yaml.safe_dump(car.owners_file, sort_keys=False))
    return Owned(truth, owners, log)


@pytest.fixture(scope="session")
def owned_truth(owned: Owned) -> Config:
    """Return the true file of that car."""
    return owned.truth


@pytest.fixture(scope="session")
def owned_drive(owned: Owned) -> Moments:
    """Return its drive, read with the true file."""
    with open_log(owned.log) as reader:
        return moments(decoded(read_frames([reader], owned.truth), owned.truth))
