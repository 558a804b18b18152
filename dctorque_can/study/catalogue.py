"""A catalogue study: every manoeuvre, by several cars, with several kinds of signals, a few draws of each."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from dctorque_can import __version__
from dctorque_can.config.load import Config
from dctorque_can.config.problems import ConfigError
from dctorque_can.config.section import Section, problem_order, validate
from dctorque_can.offline.simulated_car import DriveName, drive_of
from dctorque_can.simulation.drive import missing_gears
from dctorque_can.study.code import EVERYTHING, code
from dctorque_can.study.draw import drawn
from dctorque_can.study.factors import FACTORS
from dctorque_can.study.plan import FactorSection, believed, check_limits, factor_name, read_study

MIXED_S = 180.0
"""Length of a mixed drive of a catalogue."""


def drive_name(name: Any) -> str:
    """Return the name of a drive as it is.

    Raises:
        ValueError: there is no such drive; the message names those that there are.
    """
    if name in list(DriveName):
        return str(name)
    raise ValueError(f"unknown drive; there is: {', '.join(DriveName)}")


class SignalsSection(Section):
    """One kind of signals."""

    unsigned: Literal["none", "wheels", "shafts", "all"] = "none"
    """Speeds sent without their sign, as in ``dctorque simulate``."""
    set: dict[str, str] = Field(default_factory=dict)
    """Keys of the vehicle files that differ, with dots, e.g. ``databases.0.file``."""


class CatalogueSection(Section):
    """A whole catalogue study; what tells it from another one is ``vehicles``."""

    vehicles: Annotated[list[str], Field(min_length=1)]
    """Vehicle files, relative to this file, or bare names of those that ship."""
    drives: Annotated[list[Annotated[str, BeforeValidator(drive_name)]], Field(min_length=1)] = Field(
        default_factory=lambda: [*DriveName]
    )
    """What is driven, as in ``dctorque simulate``; default: everything."""
    signals: Annotated[dict[str, SignalsSection], Field(min_length=1)]
    """Kinds of signals by a name of your own."""
    profile: Literal["laboratory", "production", "inertial"] = "production"
    """How the cars measure and send, as in ``dctorque simulate``."""
    runs: Annotated[int, Field(ge=1, le=1000)] = 3
    """How many cars are drawn for each drive; the same for every kind of signals."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Of the draws, of sensor noise and of mixed drives."""
    smooth: bool = False
    """Whether the estimates are smoothed too."""
    vary: Annotated[dict[Annotated[str, BeforeValidator(factor_name)], FactorSection], Field(min_length=1)]
    """What is varied, and how it is distributed."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run of a catalogue.

    Attributes:
        vehicle: name of the vehicle file.
        drive: what is driven.
        signals: name of the kind of signals.
        draw: number of the car, from 0 on, among those of its drive.
        point: number of its draw among those of all drives.
    """

    vehicle: str
    drive: DriveName
    signals: str
    draw: int
    point: int


@dataclass(frozen=True, slots=True)
class Catalogue:
    """What is to be done.

    Attributes:
        path: of the study file.
        plan: what it says.
        configs: the cars as the estimator knows them, by name of the vehicle file and of the signals.
    """

    path: Path
    plan: CatalogueSection
    configs: dict[tuple[str, str], Config]

    @property
    def vary(self) -> dict[str, FactorSection]:
        """The varied factors in the order of `FACTORS`, whatever order the file has."""
        return {name: self.plan.vary[name] for name in FACTORS if name in self.plan.vary}

    def cases(self) -> dict[int, Case]:
        """Return every run by its number; a drive for a gear that a vehicle lacks is left out of its runs."""
        return {number: case for number, case in enumerate(self._grid()) if self._possible(case)}

    def values(self) -> dict[int, dict[str, float]]:
        """Return the values of the factors by number of the run."""
        points = drawn(self.vary, self.plan.seed, len(self.plan.drives) * self.plan.runs)
        return {number: points[case.point] for number, case in self.cases().items()}

    def _grid(self) -> Iterator[Case]:
        plan = self.plan
        for vehicle in plan.vehicles:
            for n, drive in enumerate(plan.drives):
                for draw in range(plan.runs):
                    for signals in plan.signals:
                        yield Case(vehicle, DriveName(drive), signals, draw, n * plan.runs + draw)

    def _possible(self, case: Case) -> bool:
        config = self.configs[case.vehicle, case.signals]
        return not missing_gears(config.settings.vehicle, drive_of(config, case.drive, 0, None))

    def identity(self) -> dict[str, str]:
        """Return what the results depend on: the version, and hashes of study, vehicles and code."""
        plan = self.plan.model_dump() | {
            "vary": {name: section.model_dump() for name, section in self.vary.items()}
        }
        vehicles = [
            (*names, name, hashlib.sha256(content).hexdigest())
            for names, config in self.configs.items()
            for name, content in sorted(config.documents.items())
        ]
        return {
            "study": _sha256(json.dumps(plan, sort_keys=True)),
            "vehicle": _sha256(json.dumps(vehicles)),
            "version": __version__,
            "code": code(EVERYTHING),
        }


def is_catalogue(path: Path) -> bool:
    """Return whether a study file is one of a catalogue: whether it has ``vehicles``.

    Raises:
        ConfigError: it cannot be read.
    """
    return isinstance(data := read_study(path, None).data, dict) and "vehicles" in data


def load_catalogue(
    path: Path, overrides: Mapping[str, str] | None = None, changes: Mapping[str, Any] | None = None
) -> Catalogue:
    """Load a catalogue study and its vehicles.

    Args:
        path: of the study file.
        overrides: dotted key to value, laid over every vehicle file.
        changes: values of the study's own keys instead of the file's.

    Raises:
        ConfigError: with every error of the study, and of the vehicle files that are found.
    """
    document = read_study(path, changes)
    plan = validate(document, (), CatalogueSection)
    check_limits(document)
    configs: dict[tuple[str, str], Config] = {}
    for n, vehicle in enumerate(plan.vehicles if plan else ()):
        for name, signals in plan.signals.items() if plan else ():
            config = believed(document, ("vehicles", n), path, {**(overrides or {}), **signals.set})
            if config is not None:
                configs[vehicle, name] = config
    problems = sorted(document.problems, key=problem_order)
    if plan is None or any(problem.severity == "error" for problem in problems):
        raise ConfigError(problems)
    return Catalogue(path, plan, configs)


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
