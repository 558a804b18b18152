"""Rows of a numpy structured array as ROS 2 messages of fixed size: one mechanism for all typed channels.

The schema text and the byte layout (CDR, little-endian) both follow from the dtype, so that many messages are
packed by one assignment and none is ever touched alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from dctorque_can.logs.errors import LogReadError
from dctorque_can.pipeline import estimates

TIME_SCHEMA = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
SCHEMA_RULE = "=" * 80 + "\n"
CDR_LITTLE_ENDIAN = (0, 1, 0, 0)  # encapsulation header of every message

_ROS_TYPES = {
    "f8": "float64",
    "f4": "float32",
    "i8": "int64",
    "u8": "uint64",
    "i4": "int32",
    "u4": "uint32",
    "i2": "int16",
    "u2": "uint16",
    "i1": "int8",
    "u1": "uint8",
    "b1": "bool",
}
_NUMPY_TYPES = {ros: numpy for numpy, ros in _ROS_TYPES.items()} | {"byte": "u1", "char": "u1"}
_FIELD_LINE = re.compile(r"(?P<type>[a-z0-9]+)(?:\[(?P<count>\d+)\])?\s+(?P<name>[a-z][a-z0-9_]*)$")


@dataclass(frozen=True)
class Table:
    """A typed channel of fixed-size rows.

    Attributes:
        topic: e.g. ``/dctorque/estimates``.
        type_name: ROS 2 type, e.g. ``dctorque_msgs/msg/Estimate``.
        dtype: structured; the first field is ``t_us`` (int64 µs), the others are numbers, booleans or
            fixed one-dimensional arrays of them.
    """

    topic: str
    type_name: str
    dtype: np.dtype[np.void]

    def __post_init__(self) -> None:
        names = self.dtype.names or ()
        if names[:1] != ("t_us",) or self.dtype["t_us"] != np.int64:
            raise ValueError(f"{self.topic}: the first field of a table is t_us (int64), not {names[:1]}")
        for name in names:
            kind, shape = _base(self.dtype, name)
            if kind not in _ROS_TYPES or len(shape) > 1:
                raise ValueError(f"{self.topic}: field {name} of type {self.dtype[name]} has no ROS 2 type")

    @classmethod
    def of_signals(cls, message: str, dtype: np.dtype[np.void]) -> Self:
        """Return the table of the decoded signals of one DBC message, on ``/signals/<message>``."""
        type_name = "".join(part[:1].upper() + part[1:] for part in re.split(r"[^A-Za-z0-9]+", message))
        if not type_name[:1].isalpha():
            type_name = "Message" + type_name
        return cls(f"/signals/{message}", f"dctorque_msgs/msg/{type_name}", dtype)

    @classmethod
    def from_schema(cls, topic: str, type_name: str, text: str) -> Self:
        """Return the table that a schema text describes.

        Raises:
            LogReadError: its messages are not a time stamp and numbers of fixed size.
        """
        lines = [line.split("#")[0].strip() for line in text.split("===")[0].splitlines()]
        lines = [line for line in lines if line]
        matches = [_FIELD_LINE.match(line) for line in lines[1:]]
        fields: list[Any] = [("t_us", "i8")]
        for match in matches:
            if match is None or match["type"] not in _NUMPY_TYPES:
                break
            count = match["count"]
            fields.append((match["name"], _NUMPY_TYPES[match["type"]], *([(int(count),)] if count else [])))
        if lines[:1] != ["builtin_interfaces/Time stamp"] or len(fields) != len(lines):
            raise LogReadError(
                f"topic {topic}: messages of type {type_name} are no table; "
                "a table has a time stamp and then numbers of fixed size"
            )
        try:
            return cls(topic, type_name, np.dtype(fields, align=True))
        except (ValueError, OverflowError, MemoryError) as error:  # two fields of one name, an array of 10^20
            raise LogReadError(f"topic {topic}: the fields of {type_name} make no table: {error}") from error

    @cached_property
    def ros_names(self) -> dict[str, str]:
        """Field of the dtype to field of the message: lower case, as ROS 2 asks (``WheelSpeedFL`` ->
        ``wheel_speed_fl``)."""
        names: dict[str, str] = {}
        for name in (self.dtype.names or ())[1:]:
            base = ros_name(name)
            unique, number = base, 2
            while unique in names.values() or unique == "stamp":
                unique, number = f"{base}_{number}", number + 1
            names[name] = unique
        return names

    @cached_property
    def schema_text(self) -> str:
        """``ros2msg`` definition with everything that it needs."""
        lines = ["builtin_interfaces/Time stamp"]
        for name, ros in self.ros_names.items():
            kind, shape = _base(self.dtype, name)
            lines.append(f"{_ROS_TYPES[kind]}{f'[{shape[0]}]' if shape else ''} {ros}")
        return "\n".join(lines) + "\n" + SCHEMA_RULE + TIME_SCHEMA

    @cached_property
    def payload(self) -> np.dtype[np.void]:
        """Bytes of one message: the encapsulation header, the stamp, and every field aligned to its size."""
        names = ["encapsulation", "sec", "nanosec"]
        formats: list[Any] = [("u1", (4,)), "<i4", "<u4"]
        offsets = [0, 4, 8]
        end = 8  # CDR aligns relative to the byte after the encapsulation header
        for name in self.ros_names:
            kind, shape = _base(self.dtype, name)
            size = int(kind[1])
            start = -(-end // size) * size
            names.append(name)
            formats.append((f"<{kind}", shape) if size > 1 else (kind, shape))
            offsets.append(4 + start)
            end = start + size * (shape[0] if shape else 1)
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": 4 + end})

    @cached_property
    def _runs(self) -> tuple[np.dtype[np.void], np.dtype[np.void]]:
        """`dtype` and `payload` without the time, as fields of bytes that stand in a row in both.

        To copy a run of a row takes as long as to copy one of its numbers. Both are little-endian, as any
        processor is that the package runs on.
        """
        runs: list[tuple[int, int, int]] = []  # where it begins in a row and in a payload, and its bytes
        for name in self.ros_names:
            in_row, in_payload = (dtype.fields[name][1] for dtype in (self.dtype, self.payload) if dtype.fields)
            size = self.dtype[name].itemsize
            if runs and (in_row - runs[-1][2], in_payload - runs[-1][2]) == runs[-1][:2]:
                runs[-1] = (*runs[-1][:2], runs[-1][2] + size)
            else:
                runs.append((in_row, in_payload, size))
        names, formats = [str(n) for n in range(len(runs))], [f"V{run[2]}" for run in runs]
        of_rows, of_payload = (
            np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})
            for dtype, offsets in ((self.dtype, [r[0] for r in runs]), (self.payload, [r[1] for r in runs]))
        )
        return of_rows, of_payload

    def pack(self, rows: NDArray[np.void], out: NDArray[np.void]) -> None:
        """Write ``rows`` (`dtype` ``[n]``) to ``out`` (`payload` ``[n]``, zeroed before the first use)."""
        out["encapsulation"] = CDR_LITTLE_ENDIAN
        pack_stamp(rows["t_us"], out)
        of_rows, of_payload = self._runs
        source, target = rows.astype(self.dtype, copy=False).view(of_rows), out.view(of_payload)
        for name in of_rows.names or ():
            target[name] = source[name]

    def unpack(self, payload: NDArray[np.void], log_time: NDArray[np.uint64]) -> NDArray[np.void]:
        """Return the rows of ``payload`` (`payload` ``[n]``) that were logged at ``log_time`` (ns)."""
        rows = np.zeros(len(payload), self.dtype)
        rows["t_us"] = unpack_stamp(payload, log_time)
        of_rows, of_payload = self._runs
        source, target = payload.view(of_payload), rows.view(of_rows)
        for name in of_rows.names or ():
            target[name] = source[name]
        return rows


def pack_stamp(t_us: NDArray[np.int64], out: NDArray[np.void]) -> None:
    """Write µs to the fields sec (int32) and nanosec; zero when sec can not hold it, as the log time does."""
    sec, microsecond = np.divmod(t_us, 1_000_000)
    fits = (sec >= -(2**31)) & (sec < 2**31)
    out["sec"] = np.where(fits, sec, 0)
    out["nanosec"] = np.where(fits, microsecond * 1000, 0)


def unpack_stamp(payload: NDArray[np.void], log_time: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return µs from the fields sec and nanosec, or from the log time (ns) where these are zero."""
    ns = payload["sec"].astype(np.int64) * 1_000_000_000 + payload["nanosec"]
    stamped: NDArray[np.int64] = (ns + 500) // 1000
    return np.where(ns == 0, (log_time // np.uint64(1000)).astype(np.int64), stamped)


def log_times(t_us: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Return MCAP log times (ns, never negative) of µs."""
    return np.clip(t_us, 0, 2**63 // 1000 - 1).astype(np.uint64) * np.uint64(1000)


def ros_name(name: str) -> str:
    """Return ``name`` as a valid ROS 2 field name: lower case words joined by single underscores."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    words = re.sub(r"[^a-z0-9]+", "_", words.lower()).strip("_")
    return words if words[:1].isalpha() else f"field_{words}".rstrip("_")


def _base(dtype: np.dtype[np.void], name: str) -> tuple[str, tuple[int, ...]]:
    base, shape = dtype[name].base, dtype[name].shape
    return f"{base.kind}{base.itemsize}", shape


ESTIMATES = Table("/dctorque/estimates", "dctorque_msgs/msg/Estimate", estimates.ESTIMATE)
HEALTH = Table("/dctorque/health", "dctorque_msgs/msg/Health", estimates.HEALTH)
