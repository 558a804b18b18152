"""Samples of what closes the clutches, joined with the estimates of what they carry: one observation a window.

Windows are cut by the time of the frames alone, so that the same frames give the same observations, however they
are cut into batches. An estimate is looked up at the instants of the samples, between the rows beside them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps.settings import MapSettings
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.pipeline.estimates import ESTIMATE, Status
from dctorque_can.pipeline.samples import Samples, SampleStatus

Floats = NDArray[np.float64]

WINDOW_US = 50_000
_LONGEST_GAP_US = 50_000  # between two rows, that one may look between
_EPOCH = 1 << 52  # µs, longer than any time: what comes after a step back of the clock is later
_MOST_EPOCHS = 1 << 10
_MOST_WAITING = 10_000  # batches of samples without a row

OBSERVATION = np.dtype(
    [
        ("key", "i8"),  # end of the window, rising over steps of the clock, µs
        ("clutch", "i8"),  # 0 or 1
        ("x", "f8"),  # mean of the actuation, times `Actuation.closing_sign`
        ("rate", "f8"),  # … its change, 1/s
        ("torque_nm", "f8"),  # that the clutch carries, positive in the direction of the slip
        ("sigma_nm", "f8"),  # its standard deviation by the estimator
        ("slip_rad_s", "f8"),  # its magnitude
        ("temperature_c", "f8"),  # NaN: not known
        ("heat_j", "f8"),  # all friction work since the start
        ("seconds", "f8"),  # of the window, that the clutch slipped
    ],
    align=True,
)
"""What one window says of one clutch that slipped throughout."""

_SPOILED = int(
    Status.LIMITED
    | Status.SPEED_IMPLAUSIBLE
    | Status.VEHICLE_FILE_IMPLAUSIBLE
    | Status.INPUT_STALE
    | Status.ENGINE_SPEED_FAULT
    | Status.ENGINE_TORQUE_FAULT
)
_NOTHING = np.zeros(0, OBSERVATION)
_LATEST_KEY = 1 << 62

LAYOUTS: dict[str, np.dtype[Any]] = {
    "samples": np.dtype([("t_us", "i8"), ("value", "f8"), ("quantity", "u1"), ("status", "u1")], align=True),
    "fresh": ESTIMATE,
    "rows": ESTIMATE,
    "row_keys": np.dtype("i8"),
    "keys0": np.dtype("i8"),
    "values0": np.dtype("f8"),
    "keys1": np.dtype("i8"),
    "values1": np.dtype("f8"),
}
"""Arrays that wait in a `Join`."""


class _Clock:
    """Times of one stream as keys that never fall."""

    def __init__(self, max_step_back_us: int) -> None:
        self._max_step_back_us = max_step_back_us
        self._last_us: int | None = None
        self._epoch = 0
        self._key = -(1 << 62)

    def keys(self, t_us: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the keys of the next times; late ones count as the latest."""
        if not len(t_us):
            return t_us
        t_us = np.clip(t_us, -(_EPOCH >> 1), _EPOCH >> 1)
        last_us = int(t_us[0]) if self._last_us is None else self._last_us
        latest = np.maximum.accumulate(np.concatenate([[last_us], t_us]))
        if (latest[1:] - t_us).max() <= self._max_step_back_us:  # nearly always
            self._last_us = int(latest[-1])
            keys = latest[1:] + self._epoch * _EPOCH
        else:
            keys = np.array([self._one(t) for t in t_us.tolist()], np.int64)
        return keys

    def _one(self, t_us: int) -> int:
        last_us = t_us if self._last_us is None else self._last_us
        if last_us - t_us > self._max_step_back_us:
            self._epoch = min(self._epoch + 1, _MOST_EPOCHS)
            last_us = t_us
        self._last_us = max(last_us, t_us)
        return self._last_us + self._epoch * _EPOCH

    def kept(self) -> list[int | None]:
        """Return its numbers."""
        return [self._last_us, self._epoch]

    def go_on_from(self, kept: list[int | None]) -> None:
        """Take over what another `kept`."""
        last_us, epoch = kept
        self._last_us = None if last_us is None else min(max(key_of(last_us), -(_EPOCH >> 1)), _EPOCH >> 1)
        self._epoch = min(max(key_of(epoch), 0), _MOST_EPOCHS)


class Joined(NamedTuple):
    """What some complete windows hold.

    Attributes:
        rows: `ESTIMATE` ``[n]``; the first has been given before, or is the very first.
        ends: the last row of each window ``[m]``.
        keys: end of each window, rising over steps of the clock ``[m]``, µs.
        t_us: end of each window ``[m]``.
        speeds_m_s: of the car ``[m]``.
        temperatures_c: of both clutches ``[m, 2]``; NaN where not known.
        observations: `OBSERVATION` ``[k]`` in order of time.
    """

    rows: NDArray[np.void]
    ends: NDArray[np.intp]
    keys: NDArray[np.int64]
    t_us: NDArray[np.int64]
    speeds_m_s: Floats
    temperatures_c: Floats
    observations: NDArray[np.void]


class Join:
    """Joins samples and rows as they come.

    Args:
        settings: of the maps.
    """

    def __init__(self, settings: MapSettings) -> None:
        self._settings = settings
        self._sample_clock = _Clock(settings.max_step_back_us)
        self._row_clock = _Clock(settings.max_step_back_us)
        self._samples: list[Samples] = []  # as they came
        self._fresh: list[NDArray[np.void]] = []  # rows as they came
        self._rows: list[NDArray[np.void]] = []  # rows with their keys
        self._row_keys: list[NDArray[np.int64]] = []
        self._keys: tuple[list[NDArray[np.int64]], ...] = ([], [])
        self._values: tuple[list[Floats], ...] = ([], [])
        self._done = -(1 << 62)  # up to here windows have been given
        self._last_us = self._due_us = 0  # time of the last row, and of one with which a window is complete
        self._delay_us = max((c.delay_us for c in settings.clutches if c is not None), default=0)
        self._ratios = np.array(settings.ratios)

    def take(self, samples: Samples, rows: NDArray[np.void]) -> Joined | None:
        """Return what became complete, or None, as for nearly every live batch.

        Args:
            samples: of the next frames; they are copied.
            rows: `ESTIMATE` ``[n]`` that these frames gave; they are kept until their window is complete.
        """
        if len(samples):
            self._samples.append(_copied(samples))
        if not len(rows):
            if len(self._samples) > _MOST_WAITING:
                self._sort_samples()
            return None
        self._fresh.append(rows)
        last_us, before_us = int(rows["t_us"][-1]), self._last_us
        self._last_us = last_us
        if before_us <= last_us < self._due_us:
            return None
        self._sort_samples()
        fresh = _joined(self._fresh)
        self._fresh.clear()
        keys = self._row_clock.keys(fresh["t_us"])
        self._rows.append(fresh)
        self._row_keys.append(keys)
        last = int(keys[-1]) - self._delay_us
        until = last // WINDOW_US * WINDOW_US
        self._due_us = last_us + until + WINDOW_US - last
        return self._complete(until) if until > self._done else None

    def kept(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return copies of all that waits, as arrays of `LAYOUTS` and as numbers."""
        parts = self._samples
        columns = ("t_us", "quantity", "value", "status")
        whole = [np.concatenate([getattr(part, name) for part in parts]) if parts else () for name in columns]
        samples = np.zeros(len(whole[0]), LAYOUTS["samples"])
        for name, column in zip(columns, whole, strict=True):
            samples[name] = column
        arrays = {"samples": samples, "fresh": _joined(self._fresh), "rows": _joined(self._rows)}
        arrays["row_keys"] = np.concatenate([np.zeros(0, np.int64), *self._row_keys])
        for i in range(2):
            arrays[f"keys{i}"] = np.concatenate([np.zeros(0, np.int64), *self._keys[i]])
            arrays[f"values{i}"] = np.concatenate([np.zeros(0), *self._values[i]])
        clocks = {"samples": self._sample_clock.kept(), "rows": self._row_clock.kept()}
        return arrays, {"done": self._done, "last_us": self._last_us, "due_us": self._due_us, "clocks": clocks}

    def go_on_from(self, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> None:
        """Go on from what another `kept`; ValueError, KeyError or TypeError: it is none."""
        gears = np.concatenate([arrays[part][name] for part in ("fresh", "rows") for name in ("gear1", "gear2")])
        if len(gears) and (gears.min() < -1 or gears.max() + 1 >= len(self._ratios)):
            raise ValueError("a gear of its rows is none")
        for keys, rows in (("row_keys", "rows"), ("keys0", "values0"), ("keys1", "values1")):
            if len(arrays[keys]) != len(arrays[rows]):
                raise ValueError("some of its rows have no time")
            if len(arrays[keys]) and np.abs(arrays[keys]).max() > _LATEST_KEY:
                raise ValueError("a time of it is none")
        if (np.diff(arrays["row_keys"]) < 0).any():
            raise ValueError("its rows are not in order of time")
        samples = arrays["samples"]
        t_us, quantity, value, status = (samples[name].copy() for name in ("t_us", "quantity", "value", "status"))
        last = np.zeros(len(samples), np.bool_)  # nobody asks here
        self._samples = [Samples(t_us, quantity, value, status, last)] if len(samples) else []
        self._fresh = [arrays["fresh"]] if len(arrays["fresh"]) else []
        self._rows = [arrays["rows"]] if len(arrays["rows"]) else []
        self._row_keys = [arrays["row_keys"]] if len(arrays["rows"]) else []
        for i in range(2):
            self._keys[i][:] = [arrays[f"keys{i}"]] if len(arrays[f"keys{i}"]) else []
            self._values[i][:] = [arrays[f"values{i}"]] if len(arrays[f"keys{i}"]) else []
        self._done, self._last_us, self._due_us = (key_of(values[name]) for name in ("done", "last_us", "due_us"))
        self._sample_clock.go_on_from(values["clocks"]["samples"])
        self._row_clock.go_on_from(values["clocks"]["rows"])

    def _sort_samples(self) -> None:
        """Take out of the waiting samples what closes the clutches."""
        if not self._samples:
            return
        columns = ("t_us", "quantity", "value", "status")
        t_us, quantity, value, status = (
            np.concatenate([getattr(part, name) for part in self._samples]) for name in columns
        )
        self._samples.clear()
        sound = status <= SampleStatus.NOT_AVAILABLE
        keys = self._sample_clock.keys(t_us[sound])
        quantity, value, ok = quantity[sound], value[sound], status[sound] == SampleStatus.OK
        for i, clutch in enumerate(self._settings.clutches):
            if clutch is not None and (mine := (quantity == clutch.quantity) & ok).any():
                self._keys[i].append(keys[mine] - clutch.delay_us)
                self._values[i].append(clutch.closing_sign * value[mine])

    def _complete(self, until: int) -> Joined:
        """Return all windows that end by ``until``, and forget what made them."""
        rows, row_keys = _joined(self._rows), np.concatenate(self._row_keys)
        observations = np.concatenate([self._of_clutch(i, until, rows, row_keys) for i in range(2)])
        observations = observations[np.lexsort((observations["clutch"], observations["key"]))]
        end = int(np.searchsorted(row_keys, until))
        begin = max(int(np.searchsorted(row_keys, self._done)) - 1, 0)
        given, given_keys = rows[begin:end], row_keys[begin:end]
        numbers = given_keys // WINDOW_US
        ends = np.flatnonzero(np.append(numbers[1:] != numbers[:-1], len(numbers) > 0))
        if begin > 0 or (len(given_keys) and given_keys[0] < self._done):
            ends = ends[given_keys[ends] >= self._done]
        keys = (numbers[ends] + 1) * WINDOW_US
        last = given[ends]
        known = last["status"][:, None] & np.array([Status.TEMPERATURE1_KNOWN, Status.TEMPERATURE2_KNOWN]) != 0
        degrees = np.column_stack([last["clutch1_temperature_c"], last["clutch2_temperature_c"]])
        kept = max(int(np.searchsorted(row_keys, until - self._delay_us)) - 1, 0)
        self._rows, self._row_keys = [_joined([rows[kept:]])], [row_keys[kept:].copy()]
        self._done = until
        temperatures = np.where(known, degrees, np.nan)
        return Joined(given, ends, keys, _time_of(keys), self._speeds(last), temperatures, observations)

    def _speeds(self, rows: NDArray[np.void]) -> Floats:
        """Return the speed of the car behind the shaft whose gear is in, m/s."""
        one = rows["gear1"] != 0
        gear = np.where(one, rows["gear1"], rows["gear2"])
        ratio = self._ratios[gear + 1]
        slip = np.where(one, rows["clutch1_slip_rad_s"], rows["clutch2_slip_rad_s"])
        shaft = np.abs(rows["engine_speed_rad_s"] - slip)
        return np.asarray(
            np.where(ratio > 0.0, shaft / np.maximum(ratio, 1e-9), 0.0) * self._settings.wheel_radius_m
        )

    def _of_clutch(
        self, i: int, until: int, rows: NDArray[np.void], row_keys: NDArray[np.int64]
    ) -> NDArray[np.void]:
        clutch = self._settings.clutches[i]
        if clutch is None or not self._keys[i]:
            return _NOTHING
        keys, values = np.concatenate(self._keys[i]), np.concatenate(self._values[i])
        order = np.argsort(keys, kind="stable")
        keys, values = keys[order], values[order]
        n = int(np.searchsorted(keys, until))
        kept = max(n - 1, 0)  # the last sample tells how fast the next one came
        self._keys[i][:], self._values[i][:] = [keys[kept:]], [values[kept:]]
        if n < 2:
            return _NOTHING
        keys, values = keys[:n], values[:n]
        step, moved = np.diff(keys), np.diff(values)
        keys, values = keys[1:], values[1:]
        usable, sign = self._usable(i, rows)
        after = np.minimum(np.searchsorted(row_keys, keys), len(rows) - 1)
        before = np.maximum(np.where(row_keys[after] == keys, after, after - 1), 0)
        good = usable[before] & usable[after] & (sign[before] == sign[after])
        good &= (row_keys[before] <= keys) & (row_keys[after] - row_keys[before] <= _LONGEST_GAP_US)
        good &= (step > 0) & (step <= clutch.timeout_us)
        window = keys // WINDOW_US
        starts = np.flatnonzero(np.append(True, window[1:] != window[:-1]))
        counts = np.diff(np.append(starts, len(window)))
        whole = np.add.reduceat(good, starts, dtype=np.int64) == counts
        if not whole.any():
            return _NOTHING
        chosen = np.repeat(whole, counts)
        before, after, step = before[chosen], after[chosen], step[chosen] * 1e-6
        span = np.maximum(row_keys[after] - row_keys[before], 1)
        share = (keys[chosen] - row_keys[before]) / span
        number, n_of, place = i + 1, counts[whole], np.repeat(np.arange(int(whole.sum())), counts[whole])

        def total(value: Floats) -> Floats:
            return np.asarray(np.bincount(place, weights=value), np.float64)

        def mean(name: str) -> Floats:
            column = rows[f"clutch{number}_{name}"]
            return np.asarray(total(column[before] + share * (column[after] - column[before])) / n_of)

        turns = sign[rows_of := before[np.append(0, np.cumsum(n_of)[:-1])]]
        seconds = total(step)
        out = np.zeros(len(n_of), OBSERVATION)
        out["key"] = (window[starts][whole] + 1) * WINDOW_US
        out["clutch"] = i
        out["x"] = total(values[chosen]) / n_of
        out["rate"] = total(moved[chosen]) / seconds
        out["torque_nm"] = mean("torque_nm") * turns
        out["sigma_nm"] = mean("sigma_nm")
        out["slip_rad_s"] = mean("slip_rad_s") * turns
        known = rows["status"][rows_of] & (Status.TEMPERATURE1_KNOWN << i) != 0
        out["temperature_c"] = np.where(known, mean("temperature_c"), np.nan)
        out["heat_j"] = mean("heat_j")
        out["seconds"] = np.minimum(seconds, WINDOW_US * 1e-6)
        return out

    def _usable(self, i: int, rows: NDArray[np.void]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Return whether each row says what clutch i carries while it slips, and which way it slips."""
        number = i + 1
        status, slip = rows["status"], rows[f"clutch{number}_slip_rad_s"]
        usable = (status & (Status.CLUTCH1_VALID << i) != 0) & (status & _SPOILED == 0)
        usable &= (rows[f"phase{number}"] == ClutchPhase.SLIPPING) & (rows[f"gear{number}"] != 0)
        usable &= rows[f"clutch{number}_sigma_nm"] > 0.0
        usable &= np.abs(slip) > self._settings.least_slip_rad_s
        return usable, np.sign(slip)


def key_of(value: Any) -> int:
    """Return a whole number that a time can be; ValueError: it is none."""
    if not isinstance(value, int) or abs(value) > _LATEST_KEY:
        raise ValueError(f"{value!r} is no time")
    return value


def _copied(samples: Samples) -> Samples:
    """Return samples that stay as they are."""
    return Samples(
        samples.t_us.copy(),
        samples.quantity.copy(),
        samples.value.copy(),
        samples.status.copy(),
        samples.last.copy(),
    )


def _joined(parts: list[NDArray[np.void]]) -> NDArray[np.void]:
    """Return rows one behind the other, copied at once instead of field by field as numpy would."""
    if not parts:
        return np.zeros(0, ESTIMATE)
    whole = np.dtype((np.void, parts[0].dtype.itemsize))
    return np.concatenate([part.view(whole) for part in parts]).view(parts[0].dtype)


def _time_of(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    return (keys + (_EPOCH >> 1)) % _EPOCH - (_EPOCH >> 1)
