"""STUDY.yaml: which car drives what, and what is varied how; all its errors at once."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from dctorque_can import __version__
from dctorque_can.config.document import Document, parse
from dctorque_can.config.load import Config, load_config, read_content
from dctorque_can.config.problems import ConfigError, KeyPath
from dctorque_can.config.section import Section, nearest, problem_order, sound_parts, validate
from dctorque_can.resources import find_config, shipped_configs
from dctorque_can.study.code import EVERYTHING, code
from dctorque_can.study.factors import FACTORS

CUT = 3.0
"""A normal distribution is cut off at so many standard deviations: no draw can leave physics."""
SHORTEST_MIXED_S = 180.0  # simulation.drive.mixed_drive


class UniformSection(Section):
    """Every value between two limits is equally likely."""

    low: float
    """Least value."""
    high: float
    """Greatest value."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.high <= self.low:
            yield ("high",), f"must be more than low ({self.low:g})"


class NormalSection(Section):
    """A normal distribution, cut off at three standard deviations."""

    mean: float
    """Mean."""
    std: Annotated[float, Field(gt=0)]
    """Standard deviation."""


class FactorSection(Section):
    """How one factor is distributed."""

    uniform: UniformSection | None = None
    """Evenly between ``low`` and ``high``."""
    normal: NormalSection | None = None
    """Normal with ``mean`` and ``std``, cut off at 3 standard deviations."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if (self.uniform is None) == (self.normal is None):
            yield (), "must have one distribution: uniform: {low: , high: } or normal: {mean: , std: }"

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest value that can be drawn."""
        if self.uniform is not None:
            return self.uniform.low, self.uniform.high
        assert self.normal is not None
        return self.normal.mean - CUT * self.normal.std, self.normal.mean + CUT * self.normal.std


def factor_name(key: Any) -> str:
    """Return the name of a factor as it is.

    Raises:
        ValueError: there is no such factor; the message names those that there are.
    """
    if key in FACTORS:
        return str(key)
    near = nearest(str(key), FACTORS)
    known = "" if near.startswith("; there is") else f"; there is: {', '.join(FACTORS)}"
    raise ValueError(f"unknown factor{near}{known}")


class StudySection(Section):
    """A whole study."""

    vehicle: str
    """Vehicle file, relative to this file, or the bare name of one that ships."""
    drive: Literal["paper", "mixed"] = "paper"
    """What is driven, as in ``dctorque simulate``: paper or mixed."""
    duration_s: Annotated[float, Field(ge=3, le=3600)] | None = None
    """Length of the drive, s; default: 16 (paper) or 360 (mixed, at least 180)."""
    profile: Literal["laboratory", "production", "inertial", "one_gear"] = "production"
    """How the car measures and sends, as in ``dctorque simulate``: laboratory, production, inertial, one_gear."""
    runs: Annotated[int, Field(ge=1, le=1_000_000)] = 200
    """How many cars are drawn."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Of the draws, of sensor noise and of a mixed drive."""
    vary: Annotated[dict[Annotated[str, BeforeValidator(factor_name)], FactorSection], Field(min_length=1)]
    """What is varied, and how it is distributed."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.drive == "mixed" and self.duration_s is not None and self.duration_s < SHORTEST_MIXED_S:
            yield ("duration_s",), f"a mixed drive needs at least {SHORTEST_MIXED_S:g} s"


@dataclass(frozen=True, slots=True)
class Study:
    """What is to be done.

    Attributes:
        path: of the study file.
        plan: what it says; ``vary`` in the order of `FACTORS`.
        config: the vehicle, as the estimator knows it.
    """

    path: Path
    plan: StudySection
    config: Config

    @property
    def vary(self) -> dict[str, FactorSection]:
        """The varied factors in the order of `FACTORS`, whatever order the file has."""
        return {name: self.plan.vary[name] for name in FACTORS if name in self.plan.vary}

    def identity(self) -> dict[str, str]:
        """Return what the result of run k depends on besides k: the version, and hashes of study, vehicle, code.

        The number of runs is not part of it: run k is the same whatever their number is.
        """
        plan = self.plan.model_dump(exclude={"runs", "vehicle"}) | {
            "vary": {name: section.model_dump() for name, section in self.vary.items()}
        }
        vehicle = {name: _sha256(content) for name, content in self.config.documents.items()}
        return {
            "study": _sha256(json.dumps(plan, sort_keys=True).encode()),
            "vehicle": _sha256(json.dumps(vehicle, sort_keys=True).encode()),
            "version": __version__,
            "code": code(EVERYTHING),
        }


def load_study(
    path: Path, overrides: Mapping[str, str] | None = None, changes: Mapping[str, Any] | None = None
) -> Study:
    """Load a study and its vehicle.

    Args:
        path: of the study file.
        overrides: dotted key to value, laid over the vehicle file.
        changes: values of the study's own keys instead of the file's; None stands for the default.

    Raises:
        ConfigError: with every error of the study, and of the vehicle file if that is found.
    """
    document = read_study(path, changes)
    plan = validate(document, (), StudySection)
    check_limits(document)
    config = believed(document, ("vehicle",), path, overrides)
    problems = sorted(document.problems, key=problem_order)
    if plan is None or config is None or any(problem.severity == "error" for problem in problems):
        raise ConfigError(problems)
    return Study(path, plan, config)


def read_study(path: Path, changes: Mapping[str, Any] | None) -> Document:
    """Return a study file with the values that the command line gives instead of its own.

    Raises:
        ConfigError: it cannot be read, is no YAML mapping, or is empty.
    """
    document = parse(read_content(path), str(path))
    if not document.data:
        raise ConfigError(document.problems)
    for key, value in (changes or {}).items():
        document.data[key] = value
        document.places[(key,)] = (f"--{key.removesuffix('_s')}", 0)
    return document


def check_limits(document: Document) -> None:
    """Report draws that no car can have, also where the rest of the file has errors."""
    vary = document.value(("vary",))
    for name, section in vary.items() if isinstance(vary, dict) else ():
        factor = FACTORS.get(name)
        for at, part in sound_parts(FactorSection, section, ("vary", name)):
            if factor is None or not isinstance(part, FactorSection) or any(part.contradictions()):
                continue
            lowest, highest = part.limits
            if lowest < factor.lowest or highest > factor.highest:
                reason = (
                    f"draws from {lowest:g} to {highest:g}, and physics allows "
                    f"{factor.lowest:g} to {factor.highest:g}: {factor.meaning[0].lower()}{factor.meaning[1:]}"
                )
                document.problems.append(document.problem(at, reason))


def believed(document: Document, at: KeyPath, path: Path, overrides: Mapping[str, str] | None) -> Config | None:
    """Return the vehicle that a study names at a key; what is wrong with it goes to ``document.problems``."""
    name = document.value(at)
    if not isinstance(name, str):
        return None  # has been reported
    file = find_config(name, path.parent)
    if not file.is_file():
        known = {*(car.stem for car in shipped_configs()), *(near.name for near in file.parent.glob("*.yaml"))}
        reason = f"there is no vehicle file {file}{nearest(name, known - {path.name})}"
        document.problems.append(document.problem(at, reason))
        return None
    try:
        return load_config(file, overrides)
    except ConfigError as error:
        document.problems += error.problems
        return None


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
