"""What a run or a replay amounted to."""

import numpy as np

from dctorque_can.analysis.health import doubts, never_received
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimates import HEALTH
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.resources import shipped_config


def test_inputs_that_never_came() -> None:
    config = load_config(shipped_config("paper_car"))
    health = np.zeros(1, HEALTH)
    mapped = [entry.quantity.name.lower() for entry in config.inputs]
    assert never_received(config.inputs, health) == mapped
    health["accepted"][0, Quantity.ENGINE_SPEED] = 1
    assert never_received(config.inputs, health) == [name for name in mapped if name != "engine_speed"]
    health["accepted"] = 1
    assert never_received(config.inputs, health) == []


def test_doubts() -> None:
    assert doubts([], 10, 1) == doubts([], 0, 0) == []
    missing, invalid = doubts(["brake", "grade"], 10, 0)
    assert "brake, grade" in missing
    assert "none of the 10 estimates" in invalid
