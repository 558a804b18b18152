"""A state as bytes, for a file that others could have written: named arrays and plain values, nothing that runs.

    dctorque state 1
    SHA-256 of all that follows
    JSON: identity, values, and name, layout and number of bytes of each array
    the arrays, one behind the other

Whoever takes it over looks at everything: the checksum finds damage, it is no proof of who wrote it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.errors import DctorqueError

_HEAD = b"dctorque state 1\n"
_LARGEST_BYTES = 50_000_000


class BadSnapshotError(DctorqueError):
    """Bytes that are no state, or none of these parts; the text says why, in the words of a subordinate clause."""


@dataclass(frozen=True)
class Snapshot:
    """A state, apart from those whose it is.

    Attributes:
        arrays: by name.
        values: what JSON can hold, by name.
    """

    arrays: Mapping[str, NDArray[Any]]
    values: Mapping[str, Any]


@cache
def layout_of(*dtypes: np.dtype[Any]) -> str:
    """Return a word for the layout of records: another one as soon as a field changes."""
    return hashlib.sha256("\n".join(map(repr, dtypes)).encode()).hexdigest()[:16]


def packed(snapshot: Snapshot, identity: Mapping[str, Any]) -> bytes:
    """Return a state with the ``identity`` of those that it is for."""
    heads = [[name, layout_of(array.dtype), array.nbytes] for name, array in snapshot.arrays.items()]
    words = {"identity": dict(identity), "values": dict(snapshot.values), "arrays": heads}
    body = json.dumps(words).encode() + b"\n" + b"".join(array.tobytes() for array in snapshot.arrays.values())
    return _HEAD + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


def unpacked(content: bytes, identity: Mapping[str, Any], dtypes: Mapping[str, np.dtype[Any]]) -> Snapshot:
    """Return what `packed` was given.

    Args:
        content: the bytes.
        identity: that it must have; its keys are the words of the error.
        dtypes: of the arrays that it must have, no more and no fewer.

    Raises:
        BadSnapshotError: it is not that.
    """
    if len(content) > _LARGEST_BYTES or not content.startswith(_HEAD):
        raise BadSnapshotError("it is none of this program")
    digest, _, body = content[len(_HEAD) :].partition(b"\n")
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise BadSnapshotError("it is damaged: its checksum is wrong")
    line, _, rest = body.partition(b"\n")
    try:
        words = json.loads(line)
        found, values, heads = words["identity"], dict(words["values"]), list(words["arrays"])
        for key, wanted in identity.items():
            if found.get(key) != wanted:
                raise BadSnapshotError(f"it is of another {key}")
        return Snapshot(_arrays(heads, rest, dtypes), values)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise BadSnapshotError(f"it is damaged: {error}") from error


def _arrays(heads: list[Any], rest: bytes, dtypes: Mapping[str, np.dtype[Any]]) -> dict[str, NDArray[Any]]:
    arrays: dict[str, NDArray[Any]] = {}
    at = 0
    if [name for name, _, _ in heads] != list(dtypes):
        raise BadSnapshotError("it is of other parts")
    for name, layout, size in heads:
        dtype = dtypes[name]
        if layout != layout_of(dtype):
            raise BadSnapshotError(f"its {name} has another layout")
        if not isinstance(size, int) or not 0 <= size <= len(rest) - at or size % dtype.itemsize:
            raise BadSnapshotError(f"its {name} has another size")
        arrays[name] = np.frombuffer(bytearray(rest[at : at + size]), dtype)
        at += size
    if at != len(rest):
        raise BadSnapshotError("it is longer than its arrays")
    return arrays
