"""A simulated drive of a configured vehicle: its frames and the truth beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dctorque_can.bus.addresses import read_addresses
from dctorque_can.config.load import Config
from dctorque_can.driveline.parameters import DrivenAxle, Vehicle
from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.offline.truth_log import shifted, truth_path, write_truth
from dctorque_can.pipeline.frames import Frames
from dctorque_can.simulation.drive import PAPER, Drive, mixed_drive, simulate
from dctorque_can.simulation.manoeuvres import MANOEUVRES, friction_drift
from dctorque_can.simulation.messages import COLUMNS
from dctorque_can.simulation.own_bus import own_bus
from dctorque_can.simulation.sensors import (
    INERTIAL,
    LABORATORY,
    MORE,
    ONE_GEAR,
    PRODUCTION,
    SensorProfile,
    Speeds,
    emit_frames,
)

START_US = 1_704_067_200_000_000  # 2024-01-01T00:00:00Z: the same seed gives the same file
MIXED_S, FRICTION_DRIFT_S = 360.0, 1200.0
SIMULATION = "simulation"
"""Metadata of a log of the simulated car; the configuration beside it is that of the car."""
_AXLES: dict[DrivenAxle, Literal["front", "rear", "all"]] = {
    DrivenAxle.FRONT: "front",
    DrivenAxle.REAR: "rear",
    DrivenAxle.ALL: "all",
}


class DriveName(StrEnum):
    """The drives that can be simulated."""

    PAPER = "paper"
    MIXED = "mixed"
    CREEP = "creep"
    ROLL_BACK = "roll_back"
    HILL_HOLD = "hill_hold"
    BRAKED_COAST_DOWN = "braked_coast_down"
    HARD_BRAKING = "hard_braking"
    KICK_DOWN = "kick_down"
    REVERSE = "reverse"
    SAILING = "sailing"
    STOP_START = "stop_start"
    WHEEL_SPIN = "wheel_spin"
    SPLIT_MU = "split_mu"
    ABORTED_SHIFT = "aborted_shift"
    TIE_UP = "tie_up"
    HARD_SYNCHRONISER = "hard_synchroniser"
    JUDDER = "judder"
    FRICTION_FADING = "friction_fading"
    TOUCH_POINT_DRIFT = "touch_point_drift"
    FRICTION_DRIFT = "friction_drift"


class ProfileName(StrEnum):
    """How the car measures and sends."""

    LABORATORY = "laboratory"
    PRODUCTION = "production"
    INERTIAL = "inertial"
    ONE_GEAR = "one_gear"
    MORE = "more"


class Unsigned(StrEnum):
    """Which speeds the car sends without their sign."""

    NONE = "none"
    WHEELS = "wheels"
    SHAFTS = "shafts"
    ALL = "all"


UNSIGNED: dict[Unsigned, frozenset[Speeds]] = {
    Unsigned.NONE: frozenset(),
    Unsigned.WHEELS: frozenset({"wheels"}),
    Unsigned.SHAFTS: frozenset({"shafts"}),
    Unsigned.ALL: frozenset({"wheels", "shafts"}),
}
"""What is sent without its sign, as `SensorProfile.unsigned`."""
_PROFILES = {
    ProfileName.LABORATORY: LABORATORY,
    ProfileName.PRODUCTION: PRODUCTION,
    ProfileName.INERTIAL: INERTIAL,
    ProfileName.ONE_GEAR: ONE_GEAR,
    ProfileName.MORE: MORE,
}


@dataclass(frozen=True)
class SimulatedDrive:
    """What one drive gave.

    Attributes:
        frames: in order of time.
        truth: `TRUTH` rows on the time scale of the frames.
        name: of the drive, the profile and the seed.
        vehicle: that drove, without payload; None when nobody knows.
    """

    frames: Frames
    truth: NDArray[np.void]
    name: str
    vehicle: Vehicle | None = None

    @property
    def seconds(self) -> float:
        """Length of the drive."""
        return float(self.truth["t_us"][-1] - self.truth["t_us"][0]) / 1e6


def simulate_car(
    config: Config,
    drive: DriveName,
    profile: ProfileName,
    seed: int,
    duration_s: float | None,
    progress: Callable[[float], None] = lambda fraction: None,
    unsigned: Unsigned = Unsigned.NONE,
) -> SimulatedDrive:
    """Simulate a drive of the vehicle of ``config``, see `frames_of`.

    Raises:
        DctorqueError: the vehicle cannot be simulated, or its DBCs lack messages of the demo car that it reads.
    """
    vehicle = config.settings.vehicle
    truth = simulate(vehicle, drive_of(config, drive, seed, duration_s), progress=progress)
    sensors = replace(sensors_of(config, profile, seed), unsigned=UNSIGNED[unsigned])
    frames = frames_of(config, truth, sensors, START_US)
    name = f"{drive} drive, {profile} signals, seed {seed}"
    if unsigned is not Unsigned.NONE:
        name += f", unsigned {unsigned}"
    return SimulatedDrive(frames, shifted(truth, START_US), name, vehicle)


def simulate_cars(
    config: Config,
    drive: DriveName,
    profile: ProfileName,
    seeds: Sequence[int],
    duration_s: float | None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[SimulatedDrive]:
    """Simulate one drive of each seed.

    Raises:
        DctorqueError: as for `simulate_car`.
    """

    def one(n: int, seed: int) -> SimulatedDrive:
        def part(fraction: float) -> None:
            progress((n + fraction) / len(seeds))

        return simulate_car(config, drive, profile, seed, duration_s, part)

    return [one(n, seed) for n, seed in enumerate(seeds)]


def write_log(config: Config, drive: SimulatedDrive, output: Path) -> Path:
    """Write frames (and, in an MCAP, truth and configuration) and return the path of the truth.

    Another format than MCAP has no place for the truth: it goes to an MCAP beside it.

    Raises:
        DctorqueError: a file cannot be written.
    """
    if output.suffix.lower() == ".mcap":
        with _mcap(config, drive, output) as log:
            log.write_frames(drive.frames)
            write_truth(log, drive.truth)
        return output
    write_frames(output, drive.frames)
    beside = truth_path(output)
    with _mcap(config, drive, beside) as log:
        write_truth(log, drive.truth)
    return beside


def _mcap(config: Config, drive: SimulatedDrive, path: Path) -> McapLog:
    return McapLog(path, documents=config.documents, metadata={SIMULATION: {"drive": drive.name}})


def frames_of(config: Config, truth: NDArray[np.void], sensors: SensorProfile, start_us: int = 0) -> Frames:
    """Return the frames of a drive on the bus of ``config``.

    A vehicle file that reads messages of the demo car gets what that car sends. Any other one has a bus of its
    own: what it reads is sent, by its DBC.

    Args:
        config: of the car; wheel speeds are sent with its radius, whatever the tyre's true one is: control units
            have it coded.
        truth: of a drive, maybe of another car.
        sensors: how the car measures and sends.
        start_us: time of the first row on the bus.

    Raises:
        DctorqueError: the DBCs lack a message of the demo car, or a message cannot be sent.
    """
    settings = config.settings
    read = {term.message for given in settings.inputs for term in given.signals}
    sent = None
    if not read & set(COLUMNS):
        mass = settings.vehicle.chassis.mass_kg
        clutches = settings.phases.clutches
        sent = own_bus(settings.inputs, config.protections, clutches, mass, config.database, sensors)
    read_from = reversed(read_addresses(config.database, config.inputs, config.addresses))
    addresses = config.addresses | dict(read_from)
    return emit_frames(truth, settings.vehicle, sensors, config.database, start_us, sent, addresses)


def drive_of(config: Config, name: DriveName, seed: int, duration_s: float | None) -> Drive:
    """Return the drive of that name for the vehicle of ``config``; the seed is that of a mixed drive.

    Raises:
        DctorqueError: it is too short.
    """
    vehicle = config.settings.vehicle
    if name is DriveName.MIXED:
        return mixed_drive(vehicle, seed, duration_s or MIXED_S)
    if name is DriveName.FRICTION_DRIFT:
        return friction_drift(mixed_drive(vehicle, seed, duration_s or FRICTION_DRIFT_S))
    drive = PAPER if name is DriveName.PAPER else MANOEUVRES[name](vehicle)
    return drive if duration_s is None else replace(drive, duration_s=duration_s)


def sensors_of(config: Config, profile: ProfileName, seed: int) -> SensorProfile:
    """Return how the car of ``config`` measures and sends; the seed is that of noise and jitter."""
    return replace(_PROFILES[profile], seed=seed, driven_axle=_AXLES[config.settings.driven_axle])
