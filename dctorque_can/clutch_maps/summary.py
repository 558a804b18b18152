"""The maps for people and scripts: plain numbers by name."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps.rows import ENERGIES_J, RESIDUALS_NM, TEMPERATURES_C

_NODES = ("actuation", "capacity_nm", "sigma_nm", "raw_nm", "samples", "valid")
_LISTS = (*_NODES, "residual_nm", "residual_rms_nm", "temperature_s", "engagements")


def maps_json(rows: NDArray[np.void]) -> list[dict[str, Any]]:
    """Return `CLUTCH_MAP` rows as JSON has them: None is not known; nodes are those that have seen anything."""
    return [_row_json(row) for row in rows]


def _row_json(row: Any) -> dict[str, Any]:
    words: dict[str, Any] = {"clutch": int(row["clutch"])}
    for name in row.dtype.names:
        if name not in ("clutch", "t_us", *_LISTS):
            words[name] = _plain(row[name])
    for name in ("touch_valid", "friction_valid", "restored"):
        words[name] = bool(row[name])
    words["residuals"] = [
        {"torque_nm": at, "mean_nm": _plain(mean), "rms_nm": _plain(rms)}
        for at, mean, rms in zip(RESIDUALS_NM, row["residual_nm"], row["residual_rms_nm"], strict=True)
    ]
    words["temperature_s"] = _by_class(TEMPERATURES_C, row["temperature_s"])
    words["engagements"] = _by_class(ENERGIES_J, row["engagements"])
    words["nodes"] = [
        {name: bool(row[name][i]) if name == "valid" else _plain(row[name][i]) for name in _NODES}
        for i in np.flatnonzero(row["samples"] > 0.0)
    ]
    return words


def _by_class(limits: tuple[float, ...], values: NDArray[Any]) -> list[dict[str, float | None]]:
    edges = [None, *limits, None]
    return [
        {"from": low, "to": high, "value": _plain(value)}
        for low, high, value in zip(edges[:-1], edges[1:], values, strict=True)
    ]


def _plain(value: Any) -> float | int | None:
    number = value.item()
    return None if isinstance(number, float) and not math.isfinite(number) else number
