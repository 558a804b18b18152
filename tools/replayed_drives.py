"""The six drives by which versions are compared: both cars, laboratory and production sensors, the rarer inputs.

Known delays, clutch commands and thermal data are in one drive; acceleration and grade, without shaft speeds, in
another.

They are made and replayed by the command line alone, so that any two versions can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from commit_environment import Side
from numpy.typing import NDArray

TOPICS = {"estimates": "/dctorque/estimates", "health": "/dctorque/health"}
METHODS = {  # arguments of `dctorque replay`
    "kalman": ("--set", "estimator.method=kalman"),
    "smoothed": ("--set", "estimator.method=kalman", "--smooth"),
    "oh2014": ("--set", "estimator.method=oh2014"),
}


@dataclass(frozen=True)
class ReplayedDrive:
    """One recording and how it is replayed.

    Attributes:
        name: one word for file names.
        car: a vehicle file that ships.
        profile: sensors of ``dctorque simulate``.
        seed: of the noise.
        settings: keys of the vehicle file to replay with.
        methods: keys of `METHODS` that can do it.
    """

    name: str
    car: str
    profile: str
    seed: int = 1
    settings: tuple[str, ...] = ()
    methods: tuple[str, ...] = tuple(METHODS)


DELAYS_MS = {
    "engine_speed": 4,
    "engine_torque": 12,
    "shaft1_speed": 7,
    "shaft2_speed": 7,
    **{f"wheel_speeds.{wheel}": 15 for wheel in ("fl", "fr", "rl", "rr")},
}
COMMAND = (
    "{signal: Gearbox.Clutch%dPosition, factor: 45, offset: -135, unit: Nm, range: [-200, 500]}"  # from the travel
)
THERMAL = "{heat_capacity_j_per_k: 5000, cooling_w_per_k: 40, coolant_c: 90}"
DRIVES = (
    ReplayedDrive("paper_car_laboratory", "paper_car", "laboratory"),
    ReplayedDrive("paper_car_production", "paper_car", "production"),
    ReplayedDrive("avante_laboratory", "avante_dct7", "laboratory"),
    ReplayedDrive("avante_production", "avante_dct7", "production"),
    ReplayedDrive(
        "paper_car_delays",
        "paper_car",
        "production",
        seed=2,
        settings=(
            *(f"inputs.{name}.delay_ms={delay}" for name, delay in DELAYS_MS.items()),
            *(f"inputs.clutch{clutch}_command={COMMAND % clutch}" for clutch in (1, 2)),
            *(f"vehicle.clutches.{clutch}.thermal={THERMAL}" for clutch in (1, 2)),
        ),
    ),
    ReplayedDrive(
        "avante_without_shafts",
        "avante_dct7",
        "inertial",
        seed=2,
        settings=(
            "inputs.shaft1_speed=null",
            "inputs.shaft2_speed=null",
            "inputs.acceleration=Inertial.LongAcceleration",
            "inputs.grade=Inertial.RoadGrade",
        ),
        methods=("kalman", "smoothed"),  # the 2014 observer needs the shaft speeds
    ),
)


def simulate(side: Side, drive: ReplayedDrive, seconds: float, log: Path) -> None:
    """Record the paper's drive (launch at 1 s, shifts, coasting from 7 s) in ``log``, with the car's own file."""
    given = ("--profile", drive.profile, "--seed", str(drive.seed), "--duration", f"{seconds:g}")
    part = log.with_name(f"part-{log.name}")
    side.dctorque("simulate", drive.car, *given, "--output", str(part), "--force")
    part.rename(log)


def replay(side: Side, drive: ReplayedDrive, method: str, log: Path, out: Path, *more: str) -> None:
    """Replay ``log`` with one of `METHODS` and write every column of estimates and health to ``out`` (npz)."""
    settings = [word for setting in drive.settings for word in ("--set", setting)]
    result = out.with_suffix(".mcap")
    side.dctorque("replay", str(log), "--output", str(result), "--force", *METHODS[method], *settings, *more)
    part = out.with_name(f"part-{out.name}")
    np.savez_compressed(part, **columns(result))
    result.unlink()
    part.rename(out)


def columns(log: Path) -> dict[str, NDArray[np.generic]]:
    """Return every column of estimates and health of an MCAP log by name, such as ``estimates.status``."""
    from dctorque_can.logs.mcap.reader import read_table  # numba: a second that wrong usage need not wait

    found = {}
    for table, topic in TOPICS.items():
        rows = read_table(log, topic)
        found |= {f"{table}.{name}": np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
    return found
