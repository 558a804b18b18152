"""The whole compiled filter, decisions and all, against the one in plain matrices that `tools/bench` times."""

import importlib
from dataclasses import replace
from pathlib import Path

import pytest

from dctorque_can.config.load import load_config
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import PAPER, simulate
from dctorque_can.simulation.sensors import PRODUCTION, emit_frames

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.mark.parametrize("car", ["paper_car", "avante_dct7"])
def test_compiled_and_plain_filter_agree(car, monkeypatch):
    """Launch, shift and coasting on production CAN; torques differ by rounding alone."""
    monkeypatch.syspath_prepend(str(TOOLS))
    plain = importlib.import_module("plain_kalman")
    configs = {
        method: load_config(shipped_config(car), {"estimator.method": method}) for method in ("oh2014", "kalman")
    }
    config = configs["kalman"]
    vehicle = config.settings.vehicle
    frames = emit_frames(simulate(vehicle, replace(PAPER, duration_s=9.0)), vehicle, PRODUCTION, config.database)
    found = plain.cost(configs, frames)
    assert found["largest_difference_nm"] <= plain.TOLERANCE_NM
    assert found["plain_over_kalman"] > 2
