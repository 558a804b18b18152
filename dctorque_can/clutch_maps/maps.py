"""The maps of both clutches: samples and estimates in, rows of the maps out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps import learner as states
from dctorque_can.clutch_maps.diagnostics import Diagnostics
from dctorque_can.clutch_maps.friction import Warmth
from dctorque_can.clutch_maps.learner import Learner
from dctorque_can.clutch_maps.published import Published
from dctorque_can.clutch_maps.rows import CLUTCH_MAP
from dctorque_can.clutch_maps.settings import Actuation, MapSettings
from dctorque_can.clutch_maps.touch_point import UNKNOWN, Touch, touch_of
from dctorque_can.clutch_maps.windows import WINDOW_US, Join, Joined
from dctorque_can.pipeline.samples import Samples

_NOTHING = np.zeros(0, CLUTCH_MAP)
_FRICTION_KNOWN = 0.1  # σ of the health index, down to which it must be
_TOUCH_KNOWN_SHARE = 0.5  # of the touch point's error by the vehicle file, down to which its σ must be


class ClutchMap:
    """One clutch: what is learned of it and what follows.

    Args:
        number: 1 or 2.
        actuation: what closes it.
        settings: of both maps.

    Attributes:
        restored: whether it began from a kept state.
    """

    def __init__(self, number: int, actuation: Actuation, settings: MapSettings) -> None:
        self.number, self.actuation, self.settings = number, actuation, settings
        self.learner = Learner(actuation, settings.capacity_nm[number - 1], settings)
        self.published = Published(settings)
        self.diagnostics = Diagnostics()
        self.warmth = Warmth()
        self.slipped_s = 0.0
        self.restored = False
        self._temperature_c = math.nan

    def learn(self, seen: NDArray[np.void]) -> None:
        """Take one `OBSERVATION`."""
        key, torque = int(seen["key"]), float(seen["torque_nm"])
        theta = self.warmth.at(key, float(seen["heat_j"]), self._above_coolant(float(seen["temperature_c"])))
        residual = self.learner.take(
            key,
            float(seen["x"]),
            float(seen["rate"]),
            torque,
            float(seen["sigma_nm"]),
            float(seen["slip_rad_s"]),
            theta,
        )
        if residual is not None:
            self.slipped_s += float(seen["seconds"])
            if self.learner.samples.max() >= self.settings.least_samples:
                self.diagnostics.surprise(torque, residual)

    def _above_coolant(self, temperature_c: float) -> float:
        return temperature_c - self.settings.coolant_c[self.number - 1]

    def row(self, key: int, t_us: int, distance_km: float, temperature_c: float) -> NDArray[np.void]:
        """Return the `CLUTCH_MAP` row ``[1]`` of now."""
        learner, published, sign = self.learner, self.published, self.actuation.closing_sign
        theta = self.warmth.now(key, self._above_coolant(temperature_c))
        covariance = published.renew(learner, theta, self.slipped_s)
        touch = self._touch(covariance)
        friction = math.exp(learner.x[states.FRICTION])
        self.diagnostics.follow(sign * touch.point, friction, distance_km)
        rows = np.zeros(1, CLUTCH_MAP)
        row = rows[0]
        row["t_us"], row["clutch"], row["restored"] = t_us, self.number, self.restored
        row["actuation"] = sign * published.grid
        row["capacity_nm"], row["sigma_nm"] = published.capacity_nm, published.sigma_nm
        row["raw_nm"], row["samples"], row["valid"] = published.raw_nm, learner.samples, published.valid
        row["touch_point"], row["touch_sigma"] = sign * touch.point, touch.point_sigma
        row["touch_valid"] = touch.point_sigma <= _TOUCH_KNOWN_SHARE * self.actuation.touch_error
        row["slope_nm_per_unit"], row["slope_sigma"] = touch.slope, touch.slope_sigma
        row["friction"] = friction
        friction_sigma = friction * math.sqrt(learner.P[states.FRICTION, states.FRICTION])
        row["friction_valid"] = published.valid.any() and friction_sigma <= _FRICTION_KNOWN
        for name, state, factor in (
            ("friction", states.FRICTION, friction),
            ("hysteresis", states.HYSTERESIS, 1.0),
            ("friction_by_heat", states.HEAT, 1.0),
            ("friction_by_slip", states.SLIP, 1.0),
        ):
            if name != "friction":
                row[name] = learner.x[state]
            row[f"{name}_sigma"] = factor * math.sqrt(learner.P[state, state])
        row["lag_s"], row["lag_sigma_s"] = learner.x[states.LAG], math.sqrt(learner.P[states.LAG, states.LAG])
        ends = [sign * end if math.isfinite(end) else math.nan for end in learner.seen]
        row["seen_least"], row["seen_most"] = min(ends), max(ends)
        row["taken"], row["refused"] = learner.taken, learner.refused
        row["slipped_s"], row["distance_km"] = self.slipped_s, distance_km
        self.diagnostics.report(row)
        return rows

    def _touch(self, covariance: NDArray[np.float64]) -> Touch:
        learner, actuation = self.learner, self.actuation
        seen = (learner.samples >= 1.0) & (self.published.grid <= learner.seen[1])
        if not seen.any():
            return UNKNOWN
        return touch_of(
            self.published.grid,
            self.published.raw_nm,
            covariance,
            seen,
            (actuation.closing_sign * actuation.touch_point, actuation.touch_error),
            learner.capacity_nm,
        )


class ClutchMaps:
    """Learns the maps of both clutches.

    What it gives depends on the frames alone, not on how they were cut into batches.

    Args:
        settings: of both maps.

    Attributes:
        clutches: the maps of the clutches that something tells the actuation of.
        distance_km: driven, since the maps were begun.
        join: joins samples and rows.
        due: key from which on rows of the maps are due; None before the first window.
        last: key and time of the last window.
        temperatures: of both clutches in it, °C.
    """

    def __init__(self, settings: MapSettings) -> None:
        self._settings = settings
        self.join = Join(settings)
        self.clutches = [
            ClutchMap(i + 1, actuation, settings)
            for i, actuation in enumerate(settings.clutches)
            if actuation is not None
        ]
        self.distance_km = 0.0
        self.due: int | None = None
        self.last: tuple[int, int] | None = None
        self.temperatures = [math.nan, math.nan]

    def take(self, samples: Samples, rows: NDArray[np.void]) -> NDArray[np.void]:
        """Learn from the samples of some frames and the estimates that they gave.

        Args:
            samples: of the frames; they are copied as far as they are needed later.
            rows: `ESTIMATE` ``[n]``; they are kept until their window is complete.

        Returns:
            `CLUTCH_MAP` ``[m]`` that became due.
        """
        joined = self.join.take(samples, rows)
        if joined is None:
            return _NOTHING
        found: list[NDArray[np.void]] = []
        keys, begin = joined.keys, 0
        if self.due is None and len(keys):
            self.due = int(keys[0]) + self._settings.period_us
        while begin < len(keys):
            assert self.due is not None
            due = int(np.searchsorted(keys, self.due))
            end = min(due + 1, len(keys))
            self._go(joined, begin, end)
            if due < len(keys):
                self.due = int(keys[due]) + self._settings.period_us
                found.append(self.now())
            begin = end
        for seen in joined.observations[
            len(keys) and np.searchsorted(joined.observations["key"], keys[-1], "right") :
        ]:
            self._of(int(seen["clutch"])).learn(seen)
        return np.concatenate(found) if found else _NOTHING

    def _go(self, joined: Joined, begin: int, end: int) -> None:
        """Take the windows from ``begin`` up to ``end``."""
        first = int(joined.ends[begin - 1]) if begin else 0
        rows, ends = joined.rows[first : joined.ends[end - 1] + 1], joined.ends[begin:end] - first
        for clutch in self.clutches:
            clutch.diagnostics.count(clutch.number - 1, rows, ends)
        times = joined.observations["key"]
        after = int(joined.keys[begin - 1]) if begin else -(1 << 62)
        for seen in joined.observations[(times > after) & (times <= joined.keys[end - 1])]:
            self._of(int(seen["clutch"])).learn(seen)
        ways = joined.speeds_m_s[begin:end] * (WINDOW_US * 1e-9)
        self.distance_km = float(np.cumsum(np.append(self.distance_km, ways))[-1])
        self.last = int(joined.keys[end - 1]), int(joined.t_us[end - 1])
        self.temperatures = joined.temperatures_c[end - 1].tolist()

    def now(self) -> NDArray[np.void]:
        """Return the `CLUTCH_MAP` rows of the last complete window; empty before the first one."""
        if self.last is None or not self.clutches:
            return _NOTHING
        key, t_us = self.last
        temperatures = self.temperatures
        rows = [
            clutch.row(key, t_us, self.distance_km, temperatures[clutch.number - 1]) for clutch in self.clutches
        ]
        return np.concatenate(rows)

    def _of(self, i: int) -> ClutchMap:
        return next(clutch for clutch in self.clutches if clutch.number == i + 1)
