"""``results.jsonl``: a header that says which study it is, then one line per finished run, in order of finishing.

Every line is handed to the operating system whole. What a crash leaves of a line is dropped, and its run is made
again.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from dctorque_can.errors import DctorqueError
from dctorque_can.study.run import Record

FORMAT = "dctorque study 3"
_WHAT = {
    "study": "another study (its file was changed)",
    "vehicle": "another vehicle file, DBC or --set",
    "code": "other code",
}


class Results:
    """The finished runs of one study in one folder.

    Args:
        path: of the file; its folder is made when missing.
        identity: what the results depend on, see `Study.identity`.
        anew: throw away what is there.
        remark: is told what had to be dropped.

    Attributes:
        records: the finished runs by their number.

    Raises:
        DctorqueError: the file holds results of something else, is damaged, or is being written by another study.
    """

    def __init__(self, path: Path, identity: Mapping[str, str], anew: bool, remark: Callable[[str], None]) -> None:
        self.path = path
        self.records: dict[int, Record] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        try:
            self._lock()
            if anew:
                os.truncate(self._file, 0)
            self._read(identity, remark)
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Results:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        os.close(self._file)

    def finished(self, runs: int) -> int:
        """Return how many of the runs 1 .. ``runs`` are there."""
        return sum(number in self.records for number in range(1, runs + 1))

    def append(self, record: Record) -> None:
        """Keep one finished run."""
        self._write(record)
        self.records[record["run"]] = record

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DctorqueError(f"{self.path}: another study is writing it just now") from error

    def _read(self, identity: Mapping[str, str], remark: Callable[[str], None]) -> None:
        content = self.path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            if whole == 0 and not _line({"format": FORMAT, **identity}).startswith(content):
                raise DctorqueError(f"{self.path}: holds no results of a study; give another folder, or --force")
            remark(f"{self.path}: the last line was cut off and is dropped; its run is made again")
            os.truncate(self._file, whole)
        lines = content[:whole].splitlines()
        if not lines:
            self._write({"format": FORMAT, **identity})
            return
        self._check_header(lines[0], identity)
        for number, line in enumerate(lines[1:], start=2):
            try:
                record = json.loads(line)
                self.records[record["run"]] = record
            except (ValueError, KeyError, TypeError) as error:
                raise DctorqueError(
                    f"{self.path}:{number}: this line is damaged; remove it (its run is made again), or --force"
                ) from error

    def _check_header(self, line: bytes, identity: Mapping[str, str]) -> None:
        header = _parsed(line)
        if header.get("format") != FORMAT:
            raise DctorqueError(f"{self.path}: holds no results of a study; give another folder, or --force")
        different = [name for name, value in identity.items() if header.get(name) != value]
        if different:
            reasons = [
                _WHAT.get(name, f"dctorque {header.get(name)} (this is {identity[name]})") for name in different
            ]
            raise DctorqueError(
                f"{self.path}: holds results of {' and '.join(reasons)}; "
                "give another folder with -o, or --force to throw them away"
            )

    def _write(self, value: Mapping[str, Any]) -> None:
        line = _line(value)
        while line:
            line = line[os.write(self._file, line) :]


def _line(value: Mapping[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False, ensure_ascii=False).encode() + b"\n"


def _parsed(line: bytes) -> dict[str, Any]:
    try:
        value = json.loads(line)
    except ValueError:
        return {}
    return value if isinstance(value, dict) else {}
