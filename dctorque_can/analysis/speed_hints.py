"""Speeds that do not agree by a share or a delay, as the Kalman filter has learned it, and the keys to look at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

CERTAIN = 4.0
"""Standard deviations by which an error must be another than none."""
LEAST_SHARE = 0.003
"""Tyres roll by that much more or less with their load, warmth and wear."""
LEAST_S = 0.005
"""Messages of a bus wait for one another for less."""


@dataclass(frozen=True, slots=True)
class SpeedHint:
    """An error of the speeds that the filter makes up for.

    Attributes:
        key: of the vehicle file, to look at first.
        measured: share, or s.
        sigma: its standard deviation.
        says: all of that in a sentence.
    """

    key: str
    measured: float
    sigma: float
    says: str


def speed_hints(health: NDArray[np.void]) -> list[dict[str, Any]]:
    """Return a hint for each error of the speeds that a `HEALTH` record ``[1]`` is sure of."""
    return [asdict(hint) for hint in _hints(health[0])]


def _hints(record: np.void) -> Iterator[SpeedHint]:
    share, sigma = float(record["wheel_scale_error"]), float(record["wheel_scale_sigma"])
    if abs(share) > max(LEAST_SHARE, CERTAIN * sigma):
        faster, larger = ("faster", "larger") if share > 0 else ("slower", "smaller")
        yield SpeedHint(
            "vehicle.chassis.wheel_radius_m",
            share,
            sigma,
            f"wheels: {100 * abs(share):.2f} ± {100 * sigma:.2f} % {faster} than shafts and ratios, made up for: "
            f"of road speeds wheel_radius_m is {larger} by that; `dctorque check --log` measures it",
        )
    for place, share in enumerate(record["gear_ratio_error"]):
        sigma = float(record["gear_ratio_sigma"][place])
        if abs(share) > max(LEAST_SHARE, CERTAIN * sigma):
            faster, larger = ("faster", "larger") if share > 0 else ("slower", "smaller")
            gear = "R" if place == 0 else str(place - 1)
            yield SpeedHint(
                f"vehicle.gears.{gear}.ratio",
                float(share),
                sigma,
                f"gear {gear}: its shaft turns {100 * abs(share):.2f} ± {100 * sigma:.2f} % {faster} than wheels "
                f"and ratio say, made up for: ratio, or final_drive, is {larger} by that; `dctorque check --log` "
                "measures it",
            )
    late, sigma = float(record["wheels_late_s"]), float(record["wheels_late_sigma_s"])
    if abs(late) > max(LEAST_S, CERTAIN * sigma):
        later = "later" if late > 0 else "earlier"
        yield SpeedHint(
            "inputs.wheel_speeds.fl.delay_ms",
            late,
            sigma,
            f"wheels: {1e3 * abs(late):.0f} ± {1e3 * sigma:.0f} ms {later} than told, against the shafts, made up "
            "for: set delay_ms of wheels or shafts; `dctorque check --log` measures it",
        )
