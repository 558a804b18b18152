"""An engine torque in per cent of a reference torque that comes once a second: as good as one in N·m."""

from dataclasses import replace

import numpy as np

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.sensors import MORE, emit_frames

from .manoeuvres import driven

TORQUE = (
    "{sum: [EngineShare.IndicatedTorque, {signal: EngineShare.FrictionTorque, factor: -1}], "
    "not_available: [4095], times: {signal: EngineReference.ReferenceTorque, not_available: [65535], "
    "timeout_ms: 3000}}"
)
BOTH = {"databases": "[../dbc/demo_car.dbc, ../dbc/demo_car_more.dbc]"}
REFERENCE = 0x103


def estimated(overrides, without=lambda t_us: t_us < 0):
    of = load_config(shipped_config("paper_car"), BOTH | overrides)
    truth = driven("paper_car", "kick_down")
    frames = emit_frames(truth, of.settings.vehicle, replace(MORE, seed=4), of.database)
    frames = frames[(frames.can_id != REFERENCE) | ~without(frames.t_us)]
    estimator = Estimator(of.settings)
    rows = estimator.feed(Decoder(of.database, of.inputs, of.protections).decode(frames)).rows
    return rows, estimator.health[0], truth


def test_as_good_as_in_newton_metres():
    errors = []
    for torque in ({}, {"inputs.engine_torque": TORQUE}):
        rows, _, truth = estimated(torque)
        valid = rows["status"] & Status.CLUTCH1_VALID != 0
        error = rows["clutch1_torque_nm"] - np.interp(rows["t_us"], truth["t_us"], truth["clutch1_torque_nm"])
        errors.append(np.sqrt(np.mean(error[valid & (rows["t_us"] > 2_000_000)] ** 2)))
    assert errors[1] < 1.1 * errors[0]


def test_the_torque_is_missing_from_the_age_of_the_reference_on():
    """It comes at 9.1 s for the last time before 21.1 s; 3 s later its value counts no more."""
    rows, health, _ = estimated({"inputs.engine_torque": TORQUE}, lambda t_us: (t_us > 9.5e6) & (t_us < 20.5e6))
    missing = rows["t_us"][rows["status"] & Status.ENGINE_TORQUE_FAULT != 0]
    assert 12.1e6 < missing.min() < 12.4e6
    assert 21.0e6 < missing.max() < 21.3e6
    assert health["timeouts"][Quantity.ENGINE_TORQUE] == 1
    assert 880 < health["not_available"][Quantity.ENGINE_TORQUE] < 920  # every 10 ms from 12.1 to 21.1 s
    late = (rows["t_us"] > 13e6) & (rows["t_us"] < 21e6)
    assert not (rows["status"][late] & Status.CLUTCH1_VALID).any()
