"""The Kalman filter of dctorque_can/estimators/kalman.py as one would write it first: plain numpy, F @ P @ F.T.

`tools/bench` times it beside the compiled one, and holds their torques against each other in the same run. The
matrices and noises are those of the compiled filter, and so are the decisions of the pipeline (gears, phases).
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import Config
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.estimators import kalman, oh2014
from dctorque_can.estimators.kalman_model import (
    DT_E,
    R_1,
    STEPS_US,
    T_C1,
    T_V,
    T_X,
    TH_D,
    TH_T1,
    W_B,
    W_C1,
    W_D,
    W_E,
    W_O,
    W_W,
    N,
)
from dctorque_can.pipeline.decisions import (
    ENGINE_SPEED,
    ENGINE_TORQUE,
    SPEED_1,
    WHEEL,
    axle_speed,
    braking,
    usable,
    wheel_speeds,
)
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.samples import Samples, SampleStatus
from dctorque_can.pipeline.settings import DrivenAxle

OPEN = ClutchPhase.OPEN
FINEST_US = STEPS_US[-1]
TOLERANCE_NM = 1e-6


class Inputs(NamedTuple):
    """What the pipeline hands to the filter with one frame; speeds as (sensor, state, value, variance)."""

    t_us: int
    starts: bool
    gears: tuple[int, int]
    phases: tuple[int, int]
    brakes: bool
    torque: float
    torque_is_new: bool
    speeds: list[tuple[int, int, float, float]]
    at_start: tuple[float, float, float, float]  # engine, both shafts, undriven wheels


class PlainKalman:
    """State, covariance, and what a frame does to them."""

    def __init__(self, compiled: kalman.Kalman) -> None:
        self.t, self.tables = compiled.tuning[0], compiled.tables
        self.x, self.P = np.zeros(N), np.zeros((N, N))
        self.rate = np.zeros(N)
        self.gear, self.drives, self.rejected = [0, 0], [True, True], [0] * 5
        self.T_en, self.t_us = 0.0, 0

    def start(self, now: Inputs) -> None:
        w_e, w_1, w_2, w_w = now.at_start
        self.x = np.zeros(N)
        self.x[[W_E, W_D, W_C1, W_C1 + 1, W_O, W_W, W_B]] = w_e, w_e, w_1, w_2, w_w, w_w, w_w
        variance = np.zeros(N)
        variance[[W_E, W_D, W_C1, W_C1 + 1]] = 4.0
        variance[[W_O, W_W, W_B]] = 0.1
        variance[TH_D : TH_D + 4] = 0.05**2
        variance[[T_X, T_V]] = 2000.0**2
        variance[[T_C1, T_C1 + 1]] = 200.0**2
        variance[[R_1, R_1 + 1]] = 100.0**2
        variance[DT_E] = self.engine_variance(now.torque)
        self.P, self.rate = np.diag(variance), np.zeros(N)
        self.T_en, self.t_us = now.torque, now.t_us
        self.gear, self.drives, self.rejected = list(now.gears), [True, True], [0] * 5

    def engine_variance(self, torque: float) -> float:
        return float(self.t["engine_error"] ** 2 + (self.t["engine_share"] * torque) ** 2)

    def predict(self, now: Inputs) -> None:
        held = now.brakes or abs(self.x[W_B]) < oh2014.STANDSTILL
        q_v = (self.t["held_load"] if held else self.t["road_load"]) ** 2
        rates = [
            self.t["rate"][now.phases[i] if self.gear[i] else OPEN] if self.gear[i] else self.t["neutral_rate"][i]
            for i in (0, 1)
        ]
        row = self.tables.row[self.gear[0] + 1, self.gear[1] + 1] + 2 * self.drives[0] + self.drives[1]
        rest = now.t_us - self.t_us + FINEST_US // 2
        for step, length_us in enumerate(STEPS_US):
            while rest >= length_us:
                rest -= length_us
                self.t_us += length_us
                F = self.tables.phi[row, step]
                Q = (
                    self.tables.noise[row, step]
                    + rates[0] ** 2 * self.tables.noise_1[row, step]
                    + rates[1] ** 2 * self.tables.noise_2[row, step]
                    + q_v * self.tables.noise_v[row, step]
                    + self.engine_variance(self.T_en) * self.tables.noise_e[row, step]
                )
                x = F @ self.x + self.tables.input[row, step] * self.T_en
                self.rate = (x - self.x) * 1e6 / length_us
                self.x, self.P = x, F @ self.P @ F.T + Q

    def measure(self, i: int, z: float, variance: float) -> None:
        H = np.zeros((1, N))
        H[0, i] = 1.0
        S = H @ self.P @ H.T + variance
        K = self.P @ H.T / S
        rest = np.eye(N) - K @ H
        self.x = self.x + K[:, 0] * (z - self.x[i])
        self.P = rest @ self.P @ rest.T + variance * K @ K.T

    def measure_gated(self, sensor: int, i: int, z: float, variance: float) -> None:
        e = z - self.x[i]
        variance += (self.t["timing_error"] * self.rate[i]) ** 2
        if e * e / (self.P[i, i] + variance) > self.t["gate"]:
            self.rejected[sensor] += 1
            if self.rejected[sensor] <= self.t["patience"]:
                return
            self.P[i, i] += e * e
        else:
            self.rejected[sensor] = 0
        self.measure(i, z, variance)

    def forget(self, i: int, value: float, variance: float) -> None:
        self.x[i] = value
        self.P[i, :] = self.P[:, i] = 0.0
        self.P[i, i] = variance

    def change_gears(self, gears: tuple[int, int]) -> None:
        for i, gear in enumerate(gears):
            if gear == self.gear[i]:
                continue
            self.gear[i] = gear
            self.forget(TH_T1 + i, 0.0, 1e-6)
            self.forget(W_C1 + i, self.x[W_C1 + i], 1e4)
            self.forget(T_C1 + i, 0.0, (self.t["open_torque"] if gear else self.t["neutral"][i]) ** 2)
            self.forget(R_1 + i, 0.0, (self.t["rate"][OPEN] if gear else self.t["neutral_rate"][i]) ** 2)

    def drag(self, i: int) -> float:
        return float(self.t["drag"][i] * (self.x[W_D] - self.x[W_C1 + i]))

    def frame(self, now: Inputs) -> tuple[float, float, float]:
        """Let one frame take effect; return both clutch torques and the output torque, N·m."""
        if now.starts:
            self.start(now)
        self.predict(now)
        if now.torque_is_new:
            change = now.torque - self.T_en
            self.P[DT_E, DT_E] += (self.t["engine_share"] * change) ** 2
            self.P[W_E, W_E] += (self.t["engine_delay"] * change) ** 2
            self.T_en = now.torque
        self.change_gears(now.gears)
        for i in (0, 1):
            if self.gear[i] == 0:
                self.measure(T_C1 + i, 0.0, 100.0 * self.t["neutral"][i] ** 2)
            elif now.phases[i] == OPEN:
                self.measure(T_C1 + i, self.drag(i), self.t["open_torque"] ** 2)
                self.measure(R_1 + i, 0.0, self.t["rate"][OPEN] ** 2)
        for speed in now.speeds:
            self.measure_gated(*speed)
        for i in (0, 1):
            torque = self.x[T_C1 + i]
            band = 2.0 + 0.1 * np.sqrt(self.P[T_C1 + i, T_C1 + i])
            if now.phases[i] == OPEN or self.gear[i] == 0:
                self.drives[i] = torque >= 0.0
            else:
                self.drives[i] = torque > -band if self.drives[i] else torque > band
        clutches = [self.x[T_C1 + i] if self.gear[i] else self.drag(i) for i in (0, 1)]
        return clutches[0], clutches[1], float(self.tables.output @ self.x)


def record(config: Config, samples: Samples) -> tuple[list[Inputs], np.ndarray, Estimator]:
    """Feed frame by frame; return what the filter is given, its torques ``[n, 3]``, and the estimator."""
    estimator = Estimator(config.settings)
    core, rules = estimator._core[0], estimator._rules[0]
    state, tuning = estimator._kalman.state[0], estimator._kalman.tuning[0]
    axle = config.settings.driven_axle
    wheels = [W_B if axle == DrivenAxle.REAR else W_W, W_B if axle == DrivenAxle.FRONT else W_W]
    inputs, torques = [], []
    was_running = False
    for one in np.split(np.arange(len(samples)), np.flatnonzero(samples.last)[:-1] + 1):
        frame = samples[one]
        estimator.feed(frame)
        if core["running"]:
            fresh = set(frame.quantity[frame.status == SampleStatus.OK].tolist())
            inputs.append(_inputs(core, rules, tuning, fresh, not was_running, wheels))
            torques.append((state["T_c1"], state["T_c2"], state["T_o"]))
        was_running = bool(core["running"])
    return inputs, np.array(torques), estimator


def _inputs(core: Any, rules: Any, tuning: Any, fresh: set[int], starts: bool, wheels: list[int]) -> Inputs:
    value = core["value"]
    speeds = [(0, W_E, float(value[ENGINE_SPEED]), tuning["engine_variance"])] if ENGINE_SPEED in fresh else []
    for i in (0, 1):
        if SPEED_1 + i in fresh:
            speeds.append((1 + i, W_C1 + i, float(value[SPEED_1 + i]), tuning["shaft_variance"]))
    for left, state in zip((WHEEL, WHEEL + 2), wheels, strict=True):
        if left in fresh or left + 1 in fresh:
            known, speed = axle_speed(core, left)
            number = 2.0 if usable(core, left) and usable(core, left + 1) else 1.0
            if known:
                speeds.append((3 if state == W_W else 4, state, speed, tuning["wheel_variance"] / number))
    undriven = wheel_speeds(core, rules)[3]
    at_start = float(value[ENGINE_SPEED]), float(value[SPEED_1]), float(value[SPEED_1 + 1]), float(undriven)
    gears = int(core["gear"][0]), int(core["gear"][1])
    return Inputs(
        t_us=int(core["t_us"]),
        starts=starts,
        gears=gears,
        phases=(int(core["phase"][0]), int(core["phase"][1])),
        brakes=bool(braking(core)),
        torque=float(value[ENGINE_TORQUE]),
        torque_is_new=ENGINE_TORQUE in fresh,
        speeds=speeds,
        at_start=at_start,
    )


def cost(configs: dict[str, Config], frames: Frames) -> dict[str, float]:
    """Return µs per frame of both methods and of the plain filter, and how far its torques are from the compiled.

    Time is that of the processor, so that other work on the machine does not count.

    Args:
        configs: of the methods ``oh2014`` and ``kalman``.
        frames: of one drive.

    Raises:
        ArithmeticError: the torques are further apart than `TOLERANCE_NM`.
    """
    decoded = configs["kalman"]
    samples = Decoder(decoded.database, decoded.inputs, decoded.protections).decode(frames)
    us = {}
    for name, config in configs.items():
        took = []
        for _ in range(5):
            estimator = Estimator(config.settings)
            start = time.thread_time()
            estimator.feed(samples)
            took.append(time.thread_time() - start)
        us[name] = 1e6 * min(took) / len(frames)
    inputs, expected, estimator = record(decoded, samples)
    plain = PlainKalman(estimator._kalman)
    found = np.zeros_like(expected)
    start = time.thread_time()
    for k, now in enumerate(inputs):
        found[k] = plain.frame(now)
    us["plain"] = 1e6 * (time.thread_time() - start) / len(inputs)
    difference = float(np.abs(found - expected).max())
    if not difference <= TOLERANCE_NM:
        raise ArithmeticError(f"torques of the plain and the compiled filter differ by {difference:.3g} N·m")
    return {
        "oh2014_us": us["oh2014"],
        "kalman_us": us["kalman"],  # the 2014 observer runs along
        "plain_us": us["plain"],
        "kalman_over_oh2014": us["kalman"] / us["oh2014"],
        "plain_over_kalman": us["plain"] / (us["kalman"] - us["oh2014"]),
        "largest_difference_nm": difference,
    }
