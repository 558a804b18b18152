"""Which files are logs of this service, and which of them go when there are too many.

Where logs are written there may be files of other vehicles, and files of people. A log of this service has a name
that begins with the stem and goes on with a time, nothing else, and says itself, in the metadata at its head,
which vehicle it is of. Both are there from the first moment, so a log that a power cut has torn is known too.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from dctorque_can.logs.mcap.head import first_metadata

MARK = "service"  # name of the metadata
_TIME = r"_[0-9]{8}T[0-9]{6}Z(_[0-9]+)?\.mcap"


@dataclass(frozen=True)
class OwnLog:
    """A log that this service wrote, now or before.

    Attributes:
        path: where it is.
        size: in bytes.
        number: of the logs of this vehicle, in the order in which they were begun; no clock has a say in that.
    """

    path: Path
    size: int
    number: int


def mark(vehicle: str, stem: str, number: int) -> dict[str, dict[str, str]]:
    """Return the metadata by which `own_logs` knows a log; they must be the first of the file."""
    return {MARK: {"vehicle": vehicle, "stem": stem, "number": str(number)}}


def own_logs(directory: Path, vehicle: str, stem: str) -> list[OwnLog]:
    """Return the logs in ``directory`` that the service of ``vehicle`` wrote under ``stem``, the oldest first.

    Raises:
        OSError: the directory cannot be read.
    """
    named = re.compile(re.escape(stem) + _TIME)
    logs = []
    with os.scandir(directory) as entries:
        for entry in entries:
            if named.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                log = _own_log(Path(entry.path), vehicle, stem)
                if log is not None:
                    logs.append(log)
    return sorted(logs, key=lambda log: (log.number, log.path.name))


def _own_log(path: Path, vehicle: str, stem: str) -> OwnLog | None:
    try:
        name, words = first_metadata(path) or ("", {})
        size = path.lstat().st_size
    except OSError:  # gone by now, or not for us to read: then it is not ours
        return None
    number = words.get("number", "")
    if name != MARK or words.get("vehicle") != vehicle or words.get("stem") != stem or not number.isdecimal():
        return None
    return OwnLog(path, size, int(number))


def make_room(logs: Iterable[OwnLog], quota_bytes: float) -> tuple[list[Path], list[str]]:
    """Delete first of ``logs`` until the rest keeps the quota; return what went, and what could not go and why."""
    logs = list(logs)
    used = sum(log.size for log in logs)
    gone, failures = [], []
    for log in logs:
        if used <= quota_bytes:
            break
        try:
            log.path.unlink(missing_ok=True)
        except OSError as error:
            failures.append(f"{log.path}: cannot be deleted to keep the quota: {error.strerror}")
            continue
        used -= log.size
        gone.append(log.path)
    return gone, failures
