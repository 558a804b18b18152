"""Several estimators over the same drives whose truth is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.comparison import Comparison, judge, shift_windows
from dctorque_can.analysis.consistency import Nis, nis
from dctorque_can.analysis.health import doubts, never_received
from dctorque_can.analysis.status_shares import BOTH_CLUTCHES, StatusShares
from dctorque_can.analysis.transmission import TransmissionFigures
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config, load_documents
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.reader import LogReader, open_log
from dctorque_can.offline.bound import BoundChain
from dctorque_can.offline.simulated_car import SIMULATION, SimulatedDrive
from dctorque_can.offline.truth_log import truth_of, truth_source
from dctorque_can.pipeline.estimates import Estimates
from dctorque_can.pipeline.frames import Frames

METHODS = ("oh2014", "kalman")
SMOOTHED = "kalman smoothed"
BOUND = "bound"
"""Name of the filter that is told the truth (`bound`)."""
BATCH = 100_000


@dataclass(frozen=True)
class Variant:
    """One of the estimators that are compared.

    Attributes:
        name: for people.
        overrides: dotted key to value, what is special about it.
        config: with these laid over it.
        smooth: the estimates are smoothed.
    """

    name: str
    overrides: Mapping[str, str]
    config: Config
    smooth: bool = False


@dataclass(frozen=True)
class VariantResult:
    """What one estimator made of all drives.

    Attributes:
        variant: the estimator.
        comparison: with the truth.
        sensors: what the innovations say, by name of the sensor; nothing where there are none.
        transmission: its driving clutch against the transmission's own torque, where that is told.
        doubts: why the figures may say little, one line each.
    """

    variant: Variant
    comparison: Comparison
    sensors: dict[str, Nis]
    transmission: dict[str, float] | None
    doubts: list[str]


def variants_of(
    load: Callable[[Mapping[str, str]], Config], more: Mapping[str, Mapping[str, str]], smooth: bool = False
) -> tuple[Variant, ...]:
    """Return both methods as they are configured, and ``more`` variants by name.

    Args:
        load: gives the configuration with these overrides laid over it.
        more: overrides (dotted key to value) by name.
        smooth: add the Kalman filter smoothed, as the third.

    Raises:
        DctorqueError: a name is given to two, or a configuration has errors; the message names the variant.
    """
    wanted: dict[str, Mapping[str, str]] = {method: {"estimator.method": method} for method in METHODS}
    if smooth:
        wanted[SMOOTHED] = wanted["kalman"]
    for name, overrides in more.items():
        if name in wanted or name == BOUND:
            taken = f"{', '.join(METHODS)} and {BOUND}"
            raise DctorqueError(f"variant {name}: this name is taken; {taken} are always compared")
        wanted[name] = overrides
    variants = []
    for name, overrides in wanted.items():
        try:
            variants.append(Variant(name, overrides, load(overrides), smooth=name == SMOOTHED))
        except DctorqueError as error:
            if name in METHODS:  # the file itself is wrong
                raise
            raise DctorqueError(f"variant {name}: {error}") from error
    return tuple(variants)


def recorded_drive(log: LogReader) -> SimulatedDrive:
    """Read frames and truth of a log of a simulated car.

    Raises:
        DctorqueError: it has no truth (`truth_log.truth_of`), or no frames.
    """
    truth = truth_of(log.path)
    frames = list(log.dated_frames())
    if not frames:
        raise DctorqueError("; ".join([f"{log.path}: the log holds no frames", *log.problems]))
    return SimulatedDrive(Frames.concatenate(frames), truth, str(log.path), _vehicle_of(log))


def _vehicle_of(log: LogReader) -> Vehicle | None:
    """Return the vehicle of the simulated car; None when the truth was copied to a log of something else."""
    source = truth_source(log.path)
    with ExitStack() as stack:
        reader = log if source == log.path else stack.enter_context(open_log(source))
        if SIMULATION not in reader.metadata:
            return None
        try:
            return load_documents(reader.documents).settings.vehicle
        except DctorqueError:  # of another version
            return None


def count_shifts(drives: Sequence[SimulatedDrive]) -> int:
    """Return how many shifts the drives have together."""
    return sum(len(shift_windows(drive.truth)) for drive in drives)


class _Chain(Protocol):
    def feed(self, frames: Frames) -> Estimates: ...

    @property
    def health(self) -> NDArray[np.void]: ...


def compare_variants(
    variants: Sequence[Variant],
    drives: Sequence[SimulatedDrive],
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[VariantResult]:
    """Run each variant over each drive, with a fresh chain each time, and compare with the truth.

    Raises:
        DctorqueError: a variant gives no estimate within the time of the truth of a drive.
    """
    results = []
    for n, variant in enumerate(variants):

        def part(fraction: float, before: int = n) -> None:
            progress((before + fraction) / len(variants))

        def chain(drive: SimulatedDrive, config: Config = variant.config, smooth: bool = variant.smooth) -> _Chain:
            return Chain(config, smooth)

        results.append(_result(variant, drives, chain, part))
    return results


def compare_bound(
    config: Config,
    drives: Sequence[SimulatedDrive],
    progress: Callable[[float], None] = lambda fraction: None,
) -> VariantResult:
    """Do the same with the Kalman filter of ``config`` that is told the vehicle, gears and phases of each drive.

    Where nobody knows the vehicle it is told that of ``config``, and that is one of the doubts.

    Raises:
        DctorqueError: as for a variant.
    """

    def chain(drive: SimulatedDrive) -> _Chain:
        return BoundChain(config, drive.vehicle or config.settings.vehicle, drive.truth)

    unknown = [
        f"{drive.name} does not say which vehicle drove: the {BOUND} is that of the configured one"
        for drive in drives
        if drive.vehicle is None
    ]
    result = _result(Variant(BOUND, {}, config), drives, chain, progress)
    return replace(result, doubts=unknown)  # what is missing or not valid has been said of the variants


def _result(
    variant: Variant,
    drives: Sequence[SimulatedDrive],
    chain_of: Callable[[SimulatedDrive], _Chain],
    progress: Callable[[float], None],
) -> VariantResult:
    """Run one variant over all drives."""
    total = sum(len(drive.frames) for drive in drives)
    done = 0
    pairs: list[tuple[NDArray[np.void], NDArray[np.void]]] = []
    healths = []
    transmission = TransmissionFigures()
    remarks: dict[str, None] = {}
    for drive in drives:
        chain = chain_of(drive)
        rows = []
        for start in range(0, len(drive.frames), BATCH):
            frames = drive.frames[start : start + BATCH]
            rows.append(chain.feed(frames).rows)
            done += len(frames)
            progress(done / total)
        estimates = chain.smoothed() if isinstance(chain, Chain) and variant.smooth else np.concatenate(rows)
        if not len(estimates):
            raise DctorqueError(
                f"{drive.name}: variant {variant.name} gives no estimate: none of the frames gave what the "
                "estimator needs (see `dctorque check`)"
            )
        healths.append(chain.health)
        missing = never_received(variant.config.inputs, chain.health)
        status = StatusShares()
        status.count(estimates["t_us"], estimates["status"])
        remarks |= dict.fromkeys(doubts(missing, len(estimates), status.having(BOTH_CLUTCHES)))
        transmission.count(estimates)
        pairs.append((estimates, drive.truth))
    try:
        comparison = judge(pairs)
    except DctorqueError as error:
        raise DctorqueError(f"variant {variant.name}: {error}") from error
    texts = [f"variant {variant.name}: {text}" for text in remarks]
    sensors = nis(np.concatenate(healths))
    return VariantResult(variant, comparison, sensors, transmission.as_json(), texts)
