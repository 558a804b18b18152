"""The defaults on buses that are noisier, and clutches that drag more, than they are told: bands stay honest."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.analysis.comparison import judge
from dctorque_can.analysis.consistency import nis
from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import PRODUCTION, Noise, emit_frames

from .drives import SIGNED

RATIOS = {"estimator.kalman.ratio_error_share": "0.0003"}  # those of the car are the file's: it is about noise
CONFIG = load_config(shipped_config("paper_car"), {"estimator.method": "kalman", **RATIOS})
TOLD = PRODUCTION.noise
NOISY = Noise(0.3, 0.3, 0.06, TOLD.engine_torque_nm, TOLD.clutch_position_mm)


@pytest.fixture(scope="module")
def truth():
    return simulate(CONFIG.settings.vehicle, PAPER)


def driven(truth, noise, inputs=CONFIG.settings.inputs):
    profile = replace(PRODUCTION, noise=noise, seed=2)
    frames = emit_frames(truth, CONFIG.settings.vehicle, profile, CONFIG.database)
    estimator = Estimator(replace(CONFIG.settings, inputs=inputs))
    return estimator, estimator.feed(
        Decoder(CONFIG.database, CONFIG.inputs, CONFIG.protections).decode(frames)
    ).rows


@pytest.mark.parametrize("signed", [True, False])
def test_three_times_the_noise_is_learned(truth, signed):
    """Within 16 s; with the configured noise alone NIS is 4.1, 1.7, 2.6, 1.4 and 4.2.

    Of shafts and driven wheels whose speeds have no sign it is learned on the way alone, and NIS counts that time.
    """
    estimator, rows = driven(truth, NOISY, SIGNED if signed else CONFIG.settings.inputs)
    most = {"engine": 1.5, "shaft1": 1.3, "shaft2": 1.5, "driven_wheels": 1.3, "undriven_wheels": 2.5}
    if not signed:
        most |= {"shaft2": 2.0, "driven_wheels": 1.4}
    for sensor, innovations in nis(estimator.health).items():
        assert 0.5 < innovations.mean < most[sensor]
    engine, _, *others = estimator.chosen.state["noise_ratio"][0]  # of the variance; it is nine
    assert min(engine, *others) > 4.0
    for torque in judge([(rows, truth)], lag=False).everything.torques.values():
        assert torque.bands is not None
        assert torque.bands.coverage[-1] > 0.97


def test_noise_as_told_is_left_alone(truth):
    estimator, _ = driven(truth, TOLD)
    ratios = estimator.chosen.state["noise_ratio"][0]
    assert np.all(ratios < 1.3)


def test_a_drag_that_is_told_wrongly_stays_within_the_bands():
    """0.02 instead of 0.005 N·m·s/rad, up to 4 N·m: as noise, under half of the errors were within 1.96 σ."""
    vehicle = CONFIG.settings.vehicle
    dragging = tuple(replace(clutch, drag_nms_per_rad=0.02) for clutch in vehicle.clutches)
    truth = simulate(replace(vehicle, clutches=dragging), PAPER)
    _, rows = driven(truth, TOLD)
    torques = judge([(rows, truth)], lag=False).everything.torques
    for torque in torques.values():
        assert torque.bands is not None
        assert torque.bands.coverage[-1] > 0.95
        assert torque.wrong_ms == 0.0
