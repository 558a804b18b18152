"""This checkout's speed as ratios to an earlier commit, measured in turns: the speed of a machine drifts.

What runs inside a commit is in ``tools/measured``: scripts for both sides, and ``names.py``, which says where that
commit keeps what they measure.
"""

from __future__ import annotations

import resource
import statistics
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from commit_environment import (
    ROOT,
    Side,
    alone,
    install,
    output_of,
    plain_checkout_side,
    progress,
    resolve,
)
from replayed_drives import DRIVES, simulate

MEASURED = ROOT / "tools" / "measured"
FILTER_S = 8.0  # launch, first shift and coasting
DRIVE_S = 16.0


@dataclass(frozen=True)
class Measurement:
    """One figure of a side.

    Attributes:
        name: what is measured, with its unit.
        of: measures it; smaller is better.
        warm: run once before it counts, and then as often as asked for; else once in all.
    """

    name: str
    of: Callable[[Side], float]
    warm: bool = True


@dataclass(frozen=True)
class Ratio:
    """Medians of one measurement, and the median of this checkout over the commit within a round."""

    name: str
    commit: float
    checkout: float
    ratio: float
    lowest: float
    highest: float


def ratios(commit: str, keep: Path, long_log: Path, rounds: int, cold: bool) -> list[Ratio]:
    """Measure this checkout against ``commit``.

    Args:
        commit: hash, branch or tag.
        keep: folder of installed commits.
        long_log: traffic of the paper's car for a whole replay.
        rounds: how often each side is measured, in turns.
        cold: also measure a demo without compiled code, which takes minutes.

    Raises:
        CommitError: one side cannot be installed or run.
    """
    full = resolve(commit)
    with alone(keep, full):
        theirs = install(full, keep)
        logs = recorded(theirs)
    ours = plain_checkout_side(keep)
    found = []
    with tempfile.TemporaryDirectory(prefix="dctorque-bench-") as folder:
        for measurement in measurements(logs | {"long": long_log}, Path(folder), cold):
            if measurement.warm:
                progress(f"{measurement.name}: warming up")
                for side in (theirs, ours):
                    measurement.of(side)
            found.append(in_turns(measurement, theirs, ours, rounds if measurement.warm else 1))
    return found


def in_turns(measurement: Measurement, theirs: Side, ours: Side, rounds: int) -> Ratio:
    """Measure both sides ``rounds`` times, the first one first in every other round."""
    values: dict[str, list[float]] = {theirs.name: [], ours.name: []}
    for n in range(rounds):
        for side in (theirs, ours) if n % 2 == 0 else (ours, theirs):
            progress(f"{measurement.name}: {n + 1} of {rounds}, {side.name}")
            values[side.name].append(measurement.of(side))
    each = [b / a for a, b in zip(values[theirs.name], values[ours.name], strict=True)]
    medians = (statistics.median(values[side.name]) for side in (theirs, ours))
    return Ratio(measurement.name, *medians, statistics.median(each), min(each), max(each))


def measurements(logs: dict[str, Path], work: Path, cold: bool) -> list[Measurement]:
    def replay(name: str) -> Callable[[Side], float]:
        return command("replay", str(logs[name]), *into(work), "--config", "paper_car")

    production, laboratory = logs["paper_car_production"], logs["drive"]
    found = [
        Measurement(
            f"one frame in the Kalman filter, {drive.name}, µs", script("filter.py", logs[drive.name], drive.car)
        )
        for drive in DRIVES
        if drive.name in logs
    ]
    found += [
        Measurement("one live frame, message to estimate, µs", script("live.py", production, "paper_car")),
        Measurement(
            "service over recv and cantools, 4000 frames/s", script("service.py", laboratory, "paper_car")
        ),
        Measurement("first replay, 1 s of traffic, processor s", replay("short")),
        Measurement(f"replay of {DRIVE_S:g} s, processor s", replay("drive")),
        Measurement("replay of the long log, processor s", replay("long")),
    ]
    if cold:
        found.append(Measurement("demo without compiled code, processor s", cold_demo, warm=False))
    return found


def into(work: Path) -> tuple[str, ...]:
    return ("--output", str(work / "out.mcap"), "--force", "--set", "estimator.method=kalman")


def recorded(side: Side) -> dict[str, Path]:
    """Return the short logs, simulated by ``side`` now or the last time."""
    folder = side.folder / "bench"
    folder.mkdir(exist_ok=True)
    plain = {drive.name: (drive, FILTER_S) for drive in DRIVES if not drive.settings}
    laboratory = plain["paper_car_laboratory"][0]
    wanted = plain | {"drive": (laboratory, DRIVE_S), "short": (plain["paper_car_production"][0], 1.0)}
    logs = {}
    for name, (drive, seconds) in wanted.items():
        logs[name] = folder / f"{name}.mcap"
        if not logs[name].exists():
            progress(f"{side.name}: simulating {name}")
            simulate(side, drive, seconds, logs[name])
    return logs


def script(name: str, log: Path, car: str) -> Callable[[Side], float]:
    """Return what runs one of the scripts of ``tools/measured`` on a side, by that commit's own names."""

    def run(side: Side) -> float:
        own = ROOT if side.name == "checkout" else side.folder / "source"
        names = own / "tools" / "measured" / "now"
        if not names.exists():
            names = MEASURED / "before"
        variables = {**side.environment, "PYTHONPATH": str(names), "OPENBLAS_NUM_THREADS": "1"}
        printed = output_of([str(side.python), str(MEASURED / name), str(log), car], side.folder, variables)
        return float(printed.split()[-1])

    return run


def command(*arguments: str) -> Callable[[Side], float]:
    """Return what gives the processor time of a ``dctorque`` command with all its processes."""

    def run(side: Side) -> float:
        before = children_s()
        side.dctorque(*arguments)
        return children_s() - before

    return run


def cold_demo(side: Side) -> float:
    with tempfile.TemporaryDirectory(prefix="dctorque-bench-cold-") as folder:
        cold = replace(side, environment={**side.environment, "NUMBA_CACHE_DIR": f"{folder}/numba"})
        return command("demo", "--output", f"{folder}/out")(cold)


def children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def told(commit: str, found: list[Ratio]) -> str:
    """Return the table."""
    lines = [f"{'':62}{commit[:12]:>13}{'checkout':>11}{'ratio':>8}  lowest … highest"]
    lines += [
        f"{one.name:62}{one.commit:13.3f}{one.checkout:11.3f}{one.ratio:8.3f}{one.lowest:8.3f} …{one.highest:6.3f}"
        for one in found
    ]
    return "\n".join(lines)
