"""The estimator: samples in, estimates and health out. The same for live frames, logs and tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.gear_pair import singular_pairs
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.driveline.phase_decision import closing_band
from dctorque_can.errors import DctorqueError
from dctorque_can.estimators import kalman, oh2014, oh2014_model
from dctorque_can.estimators.design import Method, RoadLoad
from dctorque_can.estimators.kalman import Kalman
from dctorque_can.pipeline import core, core_state, delays, parts
from dctorque_can.pipeline.estimates import ESTIMATE, HEALTH, Estimates
from dctorque_can.pipeline.rows import report
from dctorque_can.pipeline.samples import N_QUANTITIES, Samples
from dctorque_can.pipeline.settings import Settings

SETTLING = 5.0  # time constants of the slowest part before an estimate counts as converged
CAPACITY_MARGIN = 1.5  # an estimate beyond this multiple of the static capacity is limited and marked
WIDEST = 1e6  # no input of any kind can be larger, rad/s, N·m, …
NO_HEALTH = np.zeros(0, HEALTH)
BY_PERIOD = np.zeros(0, np.bool_)

Snapshot = NDArray[np.int64]
"""All that changes in an estimator while it is fed."""


class Estimator:
    """Estimates both clutch torques from samples; its state depends on the samples alone.

    Feeding a log at once, frame by frame or cut anywhere gives the same bits.

    Args:
        settings: vehicle, inputs and design.

    Raises:
        DctorqueError: two gears of different shafts have the same total ratio, or a gear number is too large.
    """

    def __init__(self, settings: Settings) -> None:
        _refuse_singular_pairs(settings.vehicle)
        self._rules = _rules(settings)
        self._constants = oh2014_model.constants(settings.vehicle, settings.observer)
        k = kalman.new(
            settings.vehicle, settings.kalman, oh2014_model.MAX_GEAR + 2, needed=settings.method is Method.KALMAN
        )
        self._now = parts.new(k, self._rules["coolant"][0])
        self._ahead = parts.new(k, self._rules["coolant"][0])
        self._queue = delays.new()
        oh2014_model.set_pair(self._now.pair[0], self._constants[0], 0, 0)

    def feed(self, samples: Samples, wanted: NDArray[np.bool_] = BY_PERIOD) -> Estimates:
        """Take samples in order of arrival and return the estimates that became due.

        Args:
            samples: any number of them.
            wanted: bool ``[n]``, after which samples an estimate is wanted; empty: as they become due.
        """
        rows = np.zeros(int(np.count_nonzero(wanted if len(wanted) else samples.last)), ESTIMATE)
        # untouched rows cost no memory
        health = np.zeros(int(np.count_nonzero(samples.last)), HEALTH)
        n_rows, n_health = core.run(
            samples.t_us,
            samples.quantity,
            samples.value,
            samples.status,
            samples.last,
            wanted,
            self._rules,
            self._constants,
            self._now,
            self._ahead,
            self._queue,
            rows,
            health,
        )
        return Estimates(rows[:n_rows], health[:n_health].copy() if n_health else NO_HEALTH)

    @property
    def kalman_filter(self) -> Kalman:
        """The filter, for its tape."""
        return self._now.kalman

    @property
    def torque_limits(self) -> NDArray[np.float64]:
        """Largest clutch torques and output torque that are published ``[3]``, N·m."""
        return np.append(self._rules["torque_limit"][0], self._rules["output_limit"][0])

    def snapshot(self) -> Snapshot:
        """Return a copy of all that changes in `feed`, but for the filter's tape and samples that wait."""
        return self._now.memory.copy()

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a `snapshot` of this estimator; the filter's tape stays, samples that wait are dropped."""
        self._now.memory[:] = snapshot
        self._queue["count"] = 0

    @property
    def health(self) -> NDArray[np.void]:
        """`HEALTH` ``[1]``: the counters at the time of the last frame."""
        row = np.zeros(1, HEALTH)
        shown = self._now
        if self._rules["longest_delay_us"][0] > 0:
            shown = self._ahead
            core.look_ahead(self._now, shown, self._rules[0], self._constants[0], self._queue[0])
        report(shown.core[0], self._now.health[0], self._now.kalman.state[0], row[0])
        return row


def warm_up(settings: Settings) -> None:
    """Compile everything that `Estimator.feed` needs, so that the first frame is as fast as the others."""
    quantities = np.arange(N_QUANTITIES, dtype=np.uint8)
    n = len(quantities)
    Estimator(settings).feed(
        Samples(np.zeros(n, np.int64), quantities, np.zeros(n), np.zeros(n, np.uint8), np.arange(n) == n - 1)
    )


def _rules(settings: Settings) -> NDArray[np.void]:
    """Return the `core_state.RULES` record ``[1]``."""
    rules = np.zeros(1, core_state.RULES)
    r = rules[0]
    r["minimum"][:], r["maximum"][:] = -WIDEST, WIDEST
    for item in settings.inputs:
        r["mapped"][item.quantity] = True
        r["minimum"][item.quantity] = max(item.minimum, -WIDEST)
        r["maximum"][item.quantity] = min(item.maximum, WIDEST)
        r["timeout_us"][item.quantity] = item.timeout_us + item.delay_us  # counted from when it was taken
        r["delay_us"][item.quantity] = item.delay_us
    r["longest_delay_us"] = max((item.delay_us for item in settings.inputs), default=0)
    design, phases, inference = settings.observer, settings.phases, settings.gear_inference
    r["step_us"] = settings.step_us
    r["estimate_period_us"] = settings.estimate_period_us
    r["health_period_us"] = settings.health_period_us
    r["max_gap_us"] = settings.max_gap_us
    r["max_step_back_us"] = settings.max_step_back_us
    slowest = min(
        design.engine_bandwidth_rad_s,
        design.shaft_bandwidth_rad_s,
        design.torque_crossover_rad_s,
        oh2014_model.slowest_acceleration_bandwidth(settings.vehicle, design),
    )
    r["settling_us"] = int(SETTLING / slowest * 1e6)
    r["learning_us"] = int(SETTLING * design.road_load_time_s * 1e6)
    r["driven_axle"] = settings.driven_axle
    if inference is not None:
        r["infer_gears"] = True
        r["engage_tolerance"] = inference.engage_tolerance
        r["release_tolerance"] = inference.release_tolerance
        r["confirm_us"] = inference.confirm_us
        r["min_wheel_speed"] = inference.min_wheel_speed_rad_s
    else:
        r["min_wheel_speed"] = oh2014.PLAUSIBLE_WHEEL_SPEED
    for i, clutch in enumerate(phases.clutches):
        r["phase_source"][i] = clutch.source
        r["closing_sign"][i], r["closed_above"][i], r["open_below"][i] = closing_band(clutch)
    r["slip_locked"] = phases.slip_locked_rad_s
    r["slip_released"] = phases.slip_released_rad_s
    r["lock_time_us"] = phases.lock_time_us
    limits = [CAPACITY_MARGIN * clutch.static_capacity_nm for clutch in settings.vehicle.clutches]
    r["torque_limit"] = limits
    r["output_limit"] = max(abs(g.total_ratio) for g in settings.vehicle.gears) * sum(limits)
    for i, thermal in enumerate(clutch.thermal for clutch in settings.vehicle.clutches):
        if thermal is not None:
            r["heats"][i] = True
            r["heat_capacity"][i] = thermal.heat_capacity_j_per_k
            r["cooling"][i] = thermal.cooling_w_per_k
            r["coolant"][i] = thermal.coolant_c
    r["method"] = settings.method
    r["sub_observer"] = design.sub_observer
    r["learns"] = design.road_load is RoadLoad.LEARNED
    return rules


def _refuse_singular_pairs(vehicle: Vehicle) -> None:
    """Raise if some pair of gears cannot be told apart by (65), (66)."""
    wrong = [
        f"gear {g.number} (shaft {g.shaft}): numbers go up to {oh2014_model.MAX_GEAR}"
        for g in vehicle.gears
        if not -1 <= g.number <= oh2014_model.MAX_GEAR or g.number == 0
    ]
    wrong += singular_pairs(vehicle)
    if wrong:
        raise DctorqueError("vehicle: " + "; ".join(wrong))
