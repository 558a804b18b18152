"""What all pages of the reproduction share: vehicles, drives, signals, and one way to estimate and to judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dctorque_can.chain import Chain
from dctorque_can.config.load import Config, load_config
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import LABORATORY, SensorProfile, emit_frames

DESIGN = "estimator.oh2014."
CARS = {"paper_car": "section 4.1 car", "avante_dct7": "section 2.3 car"}
SEEDS = range(1, 11)
MANY_SEEDS = range(1, 31)
TORQUES = ("clutch1_torque_nm", "clutch2_torque_nm", "output_torque_nm")


def car(name: str, **design: object) -> Config:
    """Return a shipped vehicle file with the 2014 observer, and changed design numbers of it."""
    changes = {DESIGN + key: str(value).lower() for key, value in design.items()}
    changes["estimator.method"] = "oh2014"
    return load_config(shipped_config(name), changes)


@cache
def paper_truth(name: str = "paper_car") -> NDArray[np.void]:
    """Return the truth of the paper's drive."""
    return simulate(car(name).settings.vehicle, PAPER)


def frames_of(truth: NDArray[np.void], name: str, profile: SensorProfile, seed: int) -> Frames:
    """Return the frames that a car sends."""
    config = car(name)
    return emit_frames(truth, config.settings.vehicle, replace(profile, seed=seed), config.database, start_us=0)


def paper_frames(seed: int, profile: SensorProfile = LABORATORY) -> Frames:
    """Return the frames of the section 4.1 car on the paper's drive."""
    return frames_of(paper_truth(), "paper_car", profile, seed)


def estimate(config: Config, frames: Frames) -> NDArray[np.void]:
    """Return the `ESTIMATE` rows that the daemon would give."""
    return Chain(config).feed(frames).rows


def on_rows(rows: NDArray[np.void], truth: NDArray[np.void], field: str) -> NDArray[np.float64]:
    """Return a column of the truth at the times of ``rows``."""
    return np.interp(rows["t_us"], truth["t_us"], truth[field])


def rms(error: NDArray[np.float64]) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(error**2)))


@dataclass(frozen=True)
class Score:
    """RMS errors over several seeds, ``[seeds, torques]``."""

    rms: NDArray[np.float64]

    def cells(self) -> list[str]:
        """Return mean ± standard deviation of each torque."""
        mean, spread = self.rms.mean(axis=0), self.rms.std(axis=0)
        return [
            f"{m:.2f} ± {s:.2f}" if m < 10 else f"{m:.1f} ± {s:.1f}" for m, s in zip(mean, spread, strict=True)
        ]


def score(
    config: Config,
    frames: Mapping[int, Frames],
    truth: NDArray[np.void],
    fields: tuple[str, str, str] = TORQUES,
) -> Score:
    """Score a configuration on the frames of several seeds."""
    result = []
    for one in frames.values():
        rows = estimate(config, one)
        result.append([rms(rows[f] - on_rows(rows, truth, true)) for f, true in zip(fields, TORQUES, strict=True)])
    return Score(np.array(result))


def table(head: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table, numbers to the right."""
    lines = ["| " + " | ".join(head) + " |", "|---" + "|--:" * (len(head) - 1) + "|"]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)])
