"""Two sets of columns against each other: bit for bit, or within a share of each column's largest value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

Columns = Mapping[str, NDArray[np.generic]]


@dataclass(frozen=True)
class Differences:
    """What two sets of columns do not have in common.

    Attributes:
        compared: number of columns that both have.
        found: one text per column that differs.
        allowed: columns that one side alone has and may have.
    """

    compared: int
    found: tuple[str, ...]
    allowed: tuple[str, ...]


def differences(
    theirs: Columns,
    ours: Columns,
    tolerance: float = 0.0,
    allow: Sequence[str] = (),
    scales: Mapping[str, float] | None = None,
) -> Differences:
    """Compare ``ours`` to ``theirs``.

    Args:
        theirs: columns by name, ``<table>.<column>``.
        ours: likewise.
        tolerance: 0 asks for equal bits; else floats may differ by this share of the largest finite value of their
            column. Integers must always be equal.
        allow: patterns of columns, with or without their table, that one side alone may have.
        scales: by name, of columns whose tolerance is a share of this and not of their own largest value.
    """
    found, allowed = [], []
    both = [name for name in theirs if name in ours]
    for name in [*theirs, *(name for name in ours if name not in theirs)]:
        if name in both:
            text = _difference(theirs[name], ours[name], tolerance, (scales or {}).get(name))
            if text:
                found.append(f"{name}: {text}")
        elif any(fnmatchcase(name, pattern) or fnmatchcase(name.split(".")[-1], pattern) for pattern in allow):
            allowed.append(name)
        else:
            found.append(f"{name}: {'new' if name in ours else 'gone'}")
    return Differences(len(both), tuple(found), tuple(allowed))


def _difference(
    theirs: NDArray[np.generic], ours: NDArray[np.generic], tolerance: float, scale: float | None
) -> str:
    if theirs.shape != ours.shape:
        return f"shape {_shape(ours)} instead of {_shape(theirs)}"
    if theirs.dtype != ours.dtype:
        return f"type {ours.dtype} instead of {theirs.dtype}"
    if not np.issubdtype(theirs.dtype, np.floating):
        other = np.atleast_1d(theirs != ours)
        return _where(other, "other values") if other.any() else ""
    return _difference_of_floats(theirs, ours, tolerance, scale)


def _difference_of_floats(
    theirs: NDArray[np.generic], ours: NDArray[np.generic], tolerance: float, scale: float | None
) -> str:
    a, b = theirs.astype(float), ours.astype(float)
    one_sided = np.isnan(a) != np.isnan(b)
    if one_sided.any():
        return _where(one_sided, "known on one side only")
    finite = np.isfinite(a) & np.isfinite(b)
    distance = np.zeros(a.shape)
    distance[finite] = np.abs(a[finite] - b[finite])
    distance[~finite & (a != b) & ~np.isnan(a)] = np.inf
    if tolerance > 0.0:
        if scale is None:
            scale = max(np.abs(a[finite]).max(initial=0.0), np.abs(b[finite]).max(initial=0.0))
        other = distance > tolerance * scale
    else:
        bits = f"u{theirs.dtype.itemsize}"
        other = theirs.view(bits) != ours.view(bits)
    if not other.any():
        return ""
    return _where(
        other, f"by up to {distance.max():.2g}" if distance.any() else "in the bits of zero or not-a-number"
    )


def _where(other: NDArray[np.bool_], what: str) -> str:
    rows = other.reshape(len(other), -1).any(axis=1)
    return f"{what} in {np.count_nonzero(rows)} of {len(rows)} rows, first {int(np.argmax(rows))}"


def _shape(column: NDArray[np.generic]) -> str:
    return "×".join(str(n) for n in column.shape)
