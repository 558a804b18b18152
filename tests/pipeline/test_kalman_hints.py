"""Weak measurements within the core: without them nothing changes, and with them no more than they are worth."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.pipeline.samples import Input, Quantity
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import INERTIAL, emit_frames

from .drives import SETTINGS as HAND_MADE
from .drives import cruise, traffic

CAR = load_config(shipped_config("avante_dct7"), {"estimator.method": "kalman"})
MAPPED = load_config(
    shipped_config("avante_dct7"),
    {
        "estimator.method": "kalman",
        "inputs.acceleration": "{signal: Inertial.LongAcceleration, not_available: [4095]}",
        "inputs.grade": "{signal: Inertial.RoadGrade, not_available: [4095]}",
    },
)
WITHOUT_BRAKE = replace(MAPPED.settings, inputs=tuple(i for i in MAPPED.inputs if i.quantity != Quantity.BRAKE))
TORQUES = ("clutch1_torque_nm", "clutch2_torque_nm", "output_torque_nm")
SIGMAS = ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm")
FOREVER_US = 10**9


@pytest.fixture(scope="module")
def truth():
    return simulate(CAR.settings.vehicle, PAPER)


@pytest.fixture(scope="module")
def frames(truth):
    return emit_frames(truth, CAR.settings.vehicle, replace(INERTIAL, seed=2), CAR.database)


def estimates(config, settings, frames):
    return (
        Estimator(settings).feed(Decoder(config.database, config.inputs, config.protections).decode(frames)).rows
    )


def test_acceleration_and_grade_narrow_the_output_torque(frames, truth):
    """On the climb: against sensors that are worth nothing σ of the output torque falls, and the bands hold."""
    worthless = replace(MAPPED.settings.kalman, acceleration_error_m_s2=10.0, grade_error_rad=0.5)
    plain = estimates(MAPPED, replace(MAPPED.settings, kalman=worthless), frames)
    hinted = estimates(MAPPED, MAPPED.settings, frames)
    times = plain["t_us"][(plain["t_us"] > 4_000_000) & (plain["t_us"] < 5_000_000)]
    sigma = []
    for rows in (plain, hinted):
        part = rows[np.isin(rows["t_us"], times)]
        error = part["output_torque_nm"] - np.interp(part["t_us"], truth["t_us"], truth["output_torque_nm"])
        assert np.mean(np.abs(error) <= 1.96 * part["output_sigma_nm"]) >= 0.9
        sigma.append(np.mean(part["output_sigma_nm"]))
    assert sigma[1] < 0.98 * sigma[0]


def test_they_are_not_used_unless_the_brake_is_known_to_be_off(frames):
    """Without the brake's signal it makes no difference how good the sensors are said to be."""
    found = []
    for settings in (MAPPED.settings, WITHOUT_BRAKE):
        best = replace(settings.kalman, acceleration_error_m_s2=0.01, grade_error_rad=0.001)
        rows = [estimates(MAPPED, replace(settings, kalman=design), frames) for design in (settings.kalman, best)]
        found.append(np.array_equal(rows[0]["output_torque_nm"], rows[1]["output_torque_nm"]))
    assert found == [False, True]


def commanded(settings, share):
    more = tuple(Input(q, (), -1e4, 1e4, FOREVER_US) for q in (Quantity.CLUTCH1_COMMAND, Quantity.CLUTCH2_COMMAND))
    kalman = replace(settings.kalman, command_error_share=share)
    return replace(settings, inputs=(*settings.inputs, *more), kalman=kalman)


def test_commands_are_not_used_unless_asked_for():
    """The engine says 60 N·m, the command of the slipping clutch 40: it is believed only where it is to be."""
    settings = replace(HAND_MADE, method=CAR.settings.method, kalman=CAR.settings.kalman)
    drive = traffic(4.0, lambda t: {**cruise(), Quantity.CLUTCH1_COMMAND: 40.0, Quantity.CLUTCH2_COMMAND: 0.0})
    plain = Estimator(settings).feed(drive).rows
    unused = Estimator(commanded(settings, None)).feed(drive).rows
    used = Estimator(commanded(settings, 0.1)).feed(drive).rows
    for name in TORQUES + SIGMAS:
        np.testing.assert_array_equal(unused[name], plain[name])
    assert used["clutch1_torque_nm"][-1] < plain["clutch1_torque_nm"][-1] - 1.0
    assert used["clutch1_sigma_nm"][-1] < plain["clutch1_sigma_nm"][-1]
