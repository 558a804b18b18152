"""Everything that commands compile, compiled beforehand: each is done once, on a second of a simulated drive."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dctorque_can.bus.output import OutputEncoder
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config
from dctorque_can.estimators.methods import Method
from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.mcap.recover import recover
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.bound import BoundChain
from dctorque_can.offline.replay import ReplayContent, ReplayTargets, replay_logs
from dctorque_can.offline.simulated_car import DriveName, ProfileName, SimulatedDrive, simulate_car, write_log
from dctorque_can.pipeline.estimates import ESTIMATE

_SECONDS = 1.0
_FORMATS = (".asc", ".blf", ".log")
"""Logs that compiled loops read, beside MCAP."""


@dataclass(frozen=True)
class Step:
    """A part of it.

    Attributes:
        what: for people.
        share: about how long it takes, in seconds of a processor, when nothing is compiled.
        act: does it.
    """

    what: str
    share: float
    act: Callable[[], None]


def warm_up(steps: Sequence[Step], progress: Callable[[float, str], None] = lambda fraction, what: None) -> None:
    """Do all steps, in their order."""
    total = sum(step.share for step in steps)
    done = 0.0
    for step in steps:
        progress(done / total, step.what)
        step.act()
        done += step.share
    progress(1.0, "")


def steps_for_service(config: Config) -> list[Step]:
    """Return what `dctorque run` of one vehicle file needs."""

    def estimator() -> None:
        Chain(config).warm_up()

    def output() -> None:
        encoder = OutputEncoder(config.output.database, config.output.ids)
        encoder.encode(np.zeros(1, ESTIMATE))

    return [Step("estimator", 50.0, estimator), Step("messages to send", 3.0, output)]


def steps_for_commands(configs: Sequence[Config]) -> list[Step]:
    """Return what all commands need.

    Args:
        configs: of the simulated car, one for each method of estimation.
    """
    return [step for n, config in enumerate(configs) for step in _steps(config, first=n == 0)]


def _steps(config: Config, first: bool) -> list[Step]:
    car: list[SimulatedDrive] = []

    def simulation() -> None:
        car.append(_one_drive(config))

    def logs() -> None:
        with tempfile.TemporaryDirectory(prefix="dctorque-warm-up-") as folder:
            _logs(config, car[0], Path(folder))

    def smoothing() -> None:
        chain = Chain(config, smooth=True)
        chain.feed(car[0].frames)
        chain.smoothed()

    def bound() -> None:
        vehicle = car[0].vehicle
        assert vehicle is not None
        BoundChain(config, vehicle, car[0].truth).feed(car[0].frames)

    name = config.settings.method.name.lower()
    steps = [
        Step("simulated car", 50.0 if first else 1.0, simulation),
        *(Step(f"{name}: {step.what}", step.share, step.act) for step in steps_for_service(config)),
        Step("logs", 12.0 if first else 1.0, logs),
    ]
    if config.settings.method is Method.KALMAN:
        steps += [Step(f"{name}: smoothing", 8.0, smoothing), Step(f"{name}: bound", 1.0, bound)]
    return steps


def _one_drive(config: Config) -> SimulatedDrive:
    return simulate_car(config, DriveName.PAPER, ProfileName.PRODUCTION, 1, _SECONDS)


def _logs(config: Config, car: SimulatedDrive, folder: Path) -> None:
    """Write and read a log of every format that has a reader of ours."""
    log, again = folder / "car.mcap", folder / "again.mcap"
    write_log(config, car, log)
    with open_log(log) as reader:
        content = ReplayContent(frames=True, signals=True, truth=True)
        replay_logs([reader], config, ReplayTargets(again), content, lambda fraction: None)
    recover(again, folder / "recovered.mcap")
    for suffix in _FORMATS:
        path = folder / f"car{suffix}"
        write_frames(path, car.frames)
        with open_log(path) as reader:
            for _ in reader.frames():
                pass
