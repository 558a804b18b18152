"""Traffic for the core: a paper car that is driven by formula, as samples at the rates of a bus."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.estimators.methods import Method
from dctorque_can.pipeline.estimates import ESTIMATE, ONLY_KALMAN, ONLY_OH2014, Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Quantity, Samples, SampleStatus, Signs
from dctorque_can.resources import shipped_config

SHIPPED = load_config(shipped_config("paper_car")).settings
SIGNED = tuple(replace(item, signs=Signs.SIGNED) for item in SHIPPED.inputs)  # so that no direction is in doubt
SETTINGS = replace(  # of the 2014 observer, whose torques follow from its poles by hand
    SHIPPED,
    method=Method.OH2014,
    inputs=SIGNED,
    estimate_period_us=1000,
    observer=replace(  # the slowest is 65 rad/s: settled after 5/65 s
        SHIPPED.observer,
        engine_bandwidth_rad_s=200.0,
        shaft_bandwidth_rad_s=200.0,
        torque_crossover_rad_s=65.0,
        acceleration_bandwidth_rad_s=200.0,
    ),
)
BY_METHOD = {method: replace(SETTINGS, method=method) for method in Method}
VEHICLE = SETTINGS.vehicle
R = {gear.number: gear.total_ratio for gear in VEHICLE.gears}
EFFICIENCY = VEHICLE.gear_efficiency * VEHICLE.final_drive_efficiency
Q = Quantity
WHEELS = (Q.WHEEL_SPEED_FL, Q.WHEEL_SPEED_FR, Q.WHEEL_SPEED_RL, Q.WHEEL_SPEED_RR)
FRAMES = (  # one frame every 2.5 ms, all of them every 10 ms
    (Q.ENGINE_SPEED, Q.ENGINE_TORQUE, Q.BRAKE),
    (Q.SHAFT1_SPEED, Q.SHAFT2_SPEED),
    (Q.GEAR1, Q.GEAR2, Q.CLUTCH1_POSITION, Q.CLUTCH2_POSITION, Q.CLUTCH1_COMMAND, Q.CLUTCH2_COMMAND),
    WHEELS,
)

S = Status
VALID = S.CLUTCH1_VALID | S.CLUTCH2_VALID | S.OUTPUT_VALID
KNOWN = S.GEARS_KNOWN | S.PHASES_KNOWN
READY = KNOWN | S.CONVERGED
LEARNED = S.ROAD_LOAD_LEARNED
JUDGEMENT = VALID | READY | LEARNED | S.INPUT_STALE | S.SPEED_IMPLAUSIBLE | S.LIMITED  # of the torques
SETTLED_MS = 85.0  # first frame 5 / 65 s after the start at 7.5 ms, when every input has been there once
LEARNED_MS = 1007.5  # five times 0.2 s after it


def known(method):
    """Return the columns of an estimate that a method knows."""
    unknown = ONLY_OH2014 if method is Method.KALMAN else ONLY_KALMAN
    return [name for name in ESTIMATE.names if name not in unknown]


def traffic(seconds, values, start_us=0):
    """Samples of a drive; ``values(t)`` gives the value of every quantity at ``t`` seconds, None for no value."""
    rows = []
    for k in range(round(seconds * 400)):
        t_us = start_us + k * 2500
        now = values((t_us - start_us) / 1e6)
        frame = [q for q in FRAMES[k % 4] if q in now]
        for q in frame:
            status = SampleStatus.NOT_AVAILABLE if now[q] is None else SampleStatus.OK
            rows.append((t_us, q, now[q] or 0.0, status, q is frame[-1]))
    return samples(rows)


def samples(rows):
    columns = list(zip(*rows, strict=True)) if rows else [()] * 5
    types = (np.int64, np.uint8, np.float64, np.uint8, np.bool_)
    return Samples(*(np.array(column, kind) for column, kind in zip(columns, types, strict=True)))


def cruise(torque=60.0, slip=40.0, wheel=20.0, g1=1, g2=2):
    """Values at steady speeds: clutch 1 slips and carries the engine's torque, clutch 2 is open."""
    return {
        Q.ENGINE_SPEED: wheel * R[g1] + slip,
        Q.ENGINE_TORQUE: torque,
        Q.SHAFT1_SPEED: wheel * R[g1],
        Q.SHAFT2_SPEED: wheel * R[g2],
        Q.GEAR1: g1,
        Q.GEAR2: g2,
        Q.CLUTCH1_POSITION: 10.0,
        Q.CLUTCH2_POSITION: 0.0,
        **dict.fromkeys(WHEELS, wheel),
    }


def rolling(dw, w_0=20.0, torque=60.0):
    """A locked clutch 1 while the wheels accelerate by ``dw`` rad/s²."""

    def values(t):
        return cruise(torque, 0.0, w_0 + dw * t)

    return values


def with_design(settings=SETTINGS, **changes):
    return replace(settings, observer=replace(settings.observer, **changes))


def estimates(settings, seconds, values, start_us=0):
    return Estimator(settings).feed(traffic(seconds, values, start_us)).rows


def timeline(rows, start_us=0, column="status"):
    """Return every change of a column as [(ms, value)]; of a status without what is known beside the torques."""
    value = rows[column] & int(JUDGEMENT) if column == "status" else rows[column]
    changes = [0, *(k for k, (a, b) in enumerate(pairwise(value), 1) if a != b)]
    kind = Status if column == "status" else int
    return [((int(rows["t_us"][k]) - start_us) / 1000, kind(int(value[k]))) for k in changes]


def at(rows, ms):
    return rows[np.searchsorted(rows["t_us"], ms * 1000)]


with_either = pytest.mark.parametrize(
    "settings", BY_METHOD.values(), ids=lambda settings: settings.method.name.lower()
)
"""For rules that hold whatever the method; a σ of zero is that of the 2014 observer. `test_kalman` has the random
traffic of the filter."""


def locked_in_first(torque=100.0):
    """A car pulled by a locked clutch 1 in first gear, gear 2 preselected and clutch 2 open: closed form."""
    chassis, gear = VEHICLE.chassis, VEHICLE.gear(1)
    efficiency = VEHICLE.gear_efficiency * VEHICLE.final_drive_efficiency
    one, two = (shaft.inertia_kgm2 + 0.001 for shaft in VEHICLE.shafts)
    J_e = VEHICLE.engine_inertia_kgm2 + VEHICLE.damper.inertia_kgm2
    J_e1 = one + two * (R[2] / R[1]) ** 2
    load = 300.0  # N·m at the wheel, unknown to the observer
    w_0, R_1 = 20.0, gear.total_ratio
    # (T_e - T_c = J_e dω),  (T_c - T_o/(η R) = J_e1 dω),  (T_o - load = J_v dω/R)
    dw = (torque - load / (efficiency * R_1)) / (J_e + J_e1 + chassis.inertia_kgm2 / (efficiency * R_1**2))
    T_c = torque - J_e * dw
    T_o = load + chassis.inertia_kgm2 * dw / R_1

    def values(t):
        w = w_0 * R_1 + dw * t
        wheel = w / R_1
        return {
            Q.ENGINE_SPEED: w,
            Q.ENGINE_TORQUE: torque,
            Q.SHAFT1_SPEED: w,
            Q.SHAFT2_SPEED: w * R[2] / R_1,
            Q.GEAR1: 1,
            Q.GEAR2: 2,
            Q.CLUTCH1_POSITION: 10.0,
            Q.CLUTCH2_POSITION: 0.0,
            Q.WHEEL_SPEED_FL: wheel,
            Q.WHEEL_SPEED_FR: wheel,
            Q.WHEEL_SPEED_RL: wheel,
            Q.WHEEL_SPEED_RR: wheel,
        }

    return values, T_c, T_o
