"""The stored drives of ``tests/golden/drives``: frames, and every 50 ms of what was once estimated from them."""

from __future__ import annotations

import csv
import lzma
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from column_differences import Differences, differences
from commit_environment import ROOT, Side
from numpy.typing import NDArray
from replayed_drives import ReplayedDrive, replay, simulate

FOLDER = ROOT / "tests" / "golden" / "drives"
ESTIMATES = FOLDER / "estimates.npz"
SCALES = FOLDER / "scales.csv"
METHODS = ("kalman", "oh2014")
SECONDS = 7.0  # launch from 1 s, the first shift after 6 s
STEP_US = 50_000
TOLERANCE = 1e-6

Columns = dict[str, NDArray[np.generic]]


def stored_log(drive: ReplayedDrive) -> Path:
    return FOLDER / f"{drive.name}.log.xz"


def record(side: Side, drive: ReplayedDrive, work: Path) -> None:
    """Simulate a drive anew and store its frames as a compressed candump log."""
    log = work / f"{drive.name}.log"
    simulate(side, drive, SECONDS, log)
    stored_log(drive).write_bytes(lzma.compress(log.read_bytes(), preset=9 | lzma.PRESET_EXTREME))


def estimate(side: Side, drive: ReplayedDrive, method: str, work: Path) -> Columns:
    """Replay the stored frames and return the thinned columns by name, such as ``estimates.status``."""
    log = work / f"{drive.name}.log"
    log.write_bytes(lzma.decompress(stored_log(drive).read_bytes()))
    out = work / f"{drive.name}.{method}.npz"
    replay(side, drive, method, log, out, "--config", drive.car)
    with np.load(out) as found:
        return thinned(dict(found))


def thinned(columns: Mapping[str, NDArray[np.generic]]) -> Columns:
    """Return the first estimate of every 50 ms, every health record, and how many estimates there are."""
    t_us = columns["estimates.t_us"]
    rows = np.searchsorted(t_us, np.arange(t_us[0], t_us[-1], STEP_US)) if len(t_us) else np.zeros(0, int)
    kept = {name: column[rows] if name.startswith("estimates.") else column for name, column in columns.items()}
    return kept | {"count.estimates": np.array([len(t_us)])}


def moved(stored: Columns, ours: Columns, scales: Mapping[str, float]) -> Differences:
    """Compare to what is stored; columns that are new since then have nothing to be compared with."""
    known = {name: column for name, column in ours.items() if name in stored}
    return differences(stored, known, TOLERANCE, scales=scales)


def load() -> dict[tuple[str, str], Columns]:
    """Return the stored columns by drive and method; floats have the 24 bits of single precision."""
    result: dict[tuple[str, str], Columns] = {}
    with np.load(ESTIMATES) as file:
        for key in file.files:
            drive, method, table = key.split(".")
            rows = file[key]
            columns = result.setdefault((drive, method), {})
            for name in rows.dtype.names:
                wide = rows[name].dtype.kind == "f"
                columns[f"{table}.{name}"] = rows[name].astype(float) if wide else rows[name].copy()
    return result


def load_scales() -> dict[str, float]:
    """Return the scale of every float column, in its unit."""
    with SCALES.open(newline="") as file:
        return {row["column"]: float(row["scale"]) for row in csv.DictReader(file)}


def store(results: Mapping[tuple[str, str], Columns]) -> None:
    """Write the columns, and as their scales their largest values in all drives."""
    tables: dict[str, NDArray[np.void]] = {}
    scales: dict[str, float] = {}
    for (drive, method), columns in results.items():
        for table in dict.fromkeys(name.split(".")[0] for name in columns):
            tables[f"{drive}.{method}.{table}"] = _rows(columns, f"{table}.")
        for name, column in columns.items():
            if column.dtype.kind == "f":
                largest = float(np.abs(column[np.isfinite(column)]).max(initial=0.0))
                scales[name] = max(scales.get(name, 0.0), largest)
    np.savez_compressed(ESTIMATES, **tables)
    with SCALES.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("column", "scale"))
        writer.writerows((name, f"{scale:.3g}") for name, scale in scales.items())


def _rows(columns: Columns, prefix: str) -> NDArray[np.void]:
    chosen = {name.removeprefix(prefix): column for name, column in columns.items() if name.startswith(prefix)}
    fields = [
        (name, "f4" if column.dtype.kind == "f" else column.dtype.str, column.shape[1:])
        for name, column in chosen.items()
    ]
    rows = np.zeros(len(next(iter(chosen.values()))), fields)
    for name, column in chosen.items():
        rows[name] = column
    return rows
