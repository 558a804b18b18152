"""Several estimators over the same drives whose truth is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.analysis.comparison import Comparison, judge, shift_windows
from dctorque_can.config.load import Config
from dctorque_can.daemon.chain import Chain
from dctorque_can.daemon.replay import truth_of
from dctorque_can.daemon.simulated_car import SimulatedDrive
from dctorque_can.daemon.summary import count_valid, doubts, never_received
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.reader import LogReader
from dctorque_can.pipeline.frames import Frames

METHODS = ("oh2014", "kalman")
SMOOTHED = "kalman smoothed"
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
        doubts: why the figures may say little, one line each.
    """

    variant: Variant
    comparison: Comparison
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
        if name in wanted:
            raise DctorqueError(f"variant {name}: this name is taken; {' and '.join(METHODS)} are always compared")
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
        DctorqueError: it has no truth (`replay.truth_of`), or no frames.
    """
    truth = truth_of(log.path)
    frames = list(log.frames())
    if not frames:
        raise DctorqueError("; ".join([f"{log.path}: the log holds no frames", *log.problems]))
    return SimulatedDrive(Frames.concatenate(frames), truth, str(log.path))


def count_shifts(drives: Sequence[SimulatedDrive]) -> int:
    """Return how many shifts the drives have together."""
    return sum(len(shift_windows(drive.truth)) for drive in drives)


def compare_variants(
    variants: Sequence[Variant],
    drives: Sequence[SimulatedDrive],
    progress: Callable[[float], None] = lambda fraction: None,
) -> list[VariantResult]:
    """Run each variant over each drive, with a fresh chain each time, and compare with the truth.

    Raises:
        DctorqueError: a variant gives no estimate within the time of the truth of a drive.
    """
    total = len(variants) * sum(len(drive.frames) for drive in drives)
    results = []
    done = 0
    for variant in variants:
        pairs: list[tuple[NDArray[np.void], NDArray[np.void]]] = []
        remarks: dict[str, None] = {}
        for drive in drives:
            chain = Chain(variant.config, variant.smooth)
            rows = []
            for start in range(0, len(drive.frames), BATCH):
                frames = drive.frames[start : start + BATCH]
                rows.append(chain.feed(frames).rows)
                done += len(frames)
                progress(done / total)
            estimates = chain.smoothed() if variant.smooth else np.concatenate(rows)
            if not len(estimates):
                raise DctorqueError(
                    f"{drive.name}: variant {variant.name} gives no estimate: none of the frames gave what the "
                    "estimator needs (see `dctorque check`)"
                )
            missing = never_received(variant.config.inputs, chain.health)
            remarks |= dict.fromkeys(doubts(missing, len(estimates), count_valid(estimates)))
            pairs.append((estimates, drive.truth))
        try:
            comparison = judge(pairs)
        except DctorqueError as error:
            raise DctorqueError(f"variant {variant.name}: {error}") from error
        results.append(VariantResult(variant, comparison, [f"variant {variant.name}: {text}" for text in remarks]))
    return results
