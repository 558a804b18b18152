"""The truth of a simulated drive in an MCAP log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dctorque_can.errors import DctorqueError
from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import Table
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.reader import open_log
from dctorque_can.simulation.truth import TRUTH

_NEEDED = "comparing needs a log of `dctorque simulate`"
TRUTHS = Table("/dctorque/truth", "dctorque_msgs/msg/Truth", TRUTH)


def truth_path(output: Path) -> Path:
    """Return where the truth goes."""
    return output if output.suffix.lower() == ".mcap" else output.with_suffix(".truth.mcap")


def shifted(truth: NDArray[np.void], start_us: int) -> NDArray[np.void]:
    """Return `TRUTH` ``[n]`` that counts from the start of the drive on the time scale of its frames."""
    rows = truth.copy()
    rows["t_us"] += start_us
    return rows


def write_truth(log: McapLog, truth: NDArray[np.void]) -> None:
    """Append rows that are on the time scale of the frames."""
    log.write_table(TRUTHS, truth)


def read_truth(path: Path) -> NDArray[np.void]:
    """Return the truth in a log; what an older version did not write is 0.

    Raises:
        DctorqueError: there is none.
    """
    stored = read_table(path, TRUTHS.topic)
    if not set(stored.dtype.names or ()) < set(TRUTH.names or ()):
        return read_table(path, TRUTHS)
    rows = np.zeros(len(stored), TRUTH)
    for name in stored.dtype.names or ():
        rows[name] = stored[name]
    return rows


def truth_source(log: Path) -> Path:
    """Return the file with the truth of a simulated log: the MCAP itself, or beside a log of another format.

    Raises:
        DctorqueError: there is none.
    """
    plain = log.with_suffix("") if log.suffix.lower() == ".gz" else log
    if plain.suffix.lower() == ".asc":
        with open_log(log) as reader:
            dated = reader.start_us is not None
        if not dated:
            raise DctorqueError(
                f"{log}: names no date that is understood. So its times count from the first frame, those of "
                "the truth from 1970: there is no comparing them; simulate to .mcap, .blf or .log"
            )
    source = truth_path(plain)
    if source != log and not source.exists():
        raise DctorqueError(f"{log}: has no truth: only an MCAP holds one, and there is no {source}; {_NEEDED}")
    return source


def truth_of(log: Path) -> NDArray[np.void]:
    """Return the truth of a simulated log.

    Raises:
        DctorqueError: there is none.
    """
    try:
        return read_truth(truth_source(log))
    except LogReadError as error:
        raise LogReadError(f"{error}; {_NEEDED}") from error
