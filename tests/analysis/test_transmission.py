"""The driving clutch against what the transmission itself believes of it."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.analysis.transmission import TransmissionFigures
from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimates import ESTIMATE, Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import MORE, emit_frames

KNOWN = Status.TRANSMISSION_TORQUE_KNOWN
BOTH = {"databases": "[../dbc/demo_car.dbc, ../dbc/demo_car_more.dbc]"}
TOLD = {"inputs.transmission_torque": "{signal: DrivingClutch.ClutchTorque, not_available: [4095]}"}


def test_only_a_valid_clutch_that_drives_alone_counts():
    """Clutch 1 is 3 N·m above 100, clutch 2 is 4 below 50 and above it; the others are not valid or not told."""
    rows = np.zeros(5, ESTIMATE)
    rows["status"] = [KNOWN | 1, KNOWN | 2, KNOWN | 2, 1, KNOWN | 3]
    rows["phase1"], rows["phase2"] = [2, 0, 1, 2, 2], [0, 1, 0, 0, 2]
    rows["gear1"], rows["gear2"] = [1, 1, 1, 1, 0], [2, 2, 2, 2, 2]
    rows["clutch1_torque_nm"] = [103, 0, 999, 999, 999]
    rows["clutch2_torque_nm"] = [0, 46, 0, 0, 54]
    rows["transmission_torque_nm"] = [100, 50, 1, 1, 50]
    figures = TransmissionFigures()
    assert figures.as_json() is None
    for part in (rows[:0], rows[:2], rows[2:]):
        figures.count(part)
    assert figures.as_json() == {
        "rms_nm": pytest.approx(np.sqrt((9 + 16 + 16) / 3)),
        "bias_nm": pytest.approx(1.0),
        "told_rms_nm": pytest.approx(np.sqrt((100**2 + 50**2 + 50**2) / 3)),
        "share": 0.6,
    }


@pytest.fixture(scope="module")
def drive():
    config = load_config(shipped_config("paper_car"), BOTH)
    truth = simulate(config.settings.vehicle, PAPER)
    profile = replace(MORE, seed=3, clutch_torque_gain=1.2)
    return truth, emit_frames(truth, config.settings.vehicle, profile, config.database)


def estimated(frames, overrides):
    of = load_config(shipped_config("paper_car"), BOTH | overrides)
    return Estimator(of.settings).feed(Decoder(of.database, of.inputs, of.protections).decode(frames)).rows


def test_a_transmission_that_believes_a_fifth_too_much(drive):
    """What is told is 1.2 times the truth, so the differences are a sixth of it."""
    truth, frames = drive
    rows = estimated(frames, TOLD)
    figures = TransmissionFigures()
    figures.count(rows)
    found = figures.as_json()
    assert found is not None
    assert found["share"] > 0.6
    assert found["rms_nm"] == pytest.approx(found["told_rms_nm"] / 6.0, rel=0.15)
    known = rows[rows["status"] & KNOWN != 0]
    true = {i: np.interp(known["t_us"], truth["t_us"], truth[f"clutch{i}_torque_nm"]) for i in (1, 2)}
    drives = np.where((known["phase1"] != 0) & (known["gear1"] != 0), true[1], true[2])
    assert np.median(np.abs(known["transmission_torque_nm"] - 1.2 * drives)) < 2.0
    shift = (truth["clutch1_capacity_nm"] > 5.0) & (truth["clutch2_capacity_nm"] > 5.0)
    both = np.interp(known["t_us"], truth["t_us"], shift.astype(float)) == 1.0
    assert both.mean() < 0.01


def test_it_is_compared_with_and_never_used(drive):
    _, frames = drive
    without, told = estimated(frames, {}), estimated(frames, TOLD)
    _, a, b = np.intersect1d(without["t_us"], told["t_us"], return_indices=True)  # its own frames have rows too
    assert len(a) > 0.99 * len(without)
    assert (without["transmission_torque_nm"] == 0.0).all()
    assert not (without["status"] & KNOWN).any()
    assert np.abs(without["clutch1_torque_nm"][a] - told["clutch1_torque_nm"][b]).max() < 5.0
