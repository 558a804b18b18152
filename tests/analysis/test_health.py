"""What a run or a replay amounted to."""

import numpy as np

from dctorque_can.analysis.health import doubts, never_received
from dctorque_can.analysis.status_shares import StatusShares, count_valid, told
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimates import ESTIMATE, HEALTH, Status
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


def test_valid_is_what_has_both_clutch_torques() -> None:
    rows = np.zeros(4, ESTIMATE)
    rows["status"] = [0, Status.CLUTCH1_VALID, Status.CLUTCH1_VALID | Status.CLUTCH2_VALID, 0xFFFF]
    assert count_valid(rows) == 2


def test_doubts() -> None:
    assert doubts([], 10, 1) == doubts([], 0, 0) == []
    missing, invalid = doubts(["brake", "grade"], 10, 0)
    assert "brake, grade" in missing
    assert "none of the 10 estimates" in invalid


def test_shares_of_the_status_are_those_of_all_estimates_however_they_come():
    """97 estimates with all valid, 2 with a fault of the engine torque and clutch 1 alone, 1 with nothing."""
    everything = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID | Status.CONVERGED
    faulty = Status.CLUTCH1_VALID | Status.ENGINE_TORQUE_FAULT
    status = np.array([*97 * [everything], faulty, 0, faulty], np.uint32)
    for size in (1, 7, 100):
        shares = StatusShares()
        shares.count(status[:0])
        for first in range(0, len(status), size):
            shares.count(status[first : first + size])
        assert shares.estimates == 100
        assert shares.having(everything) == 97
        found = shares.as_json()
        assert found["clutch1_valid"] == 0.99
        assert found["clutch2_valid"] == found["output_valid"] == 0.97
        assert found["engine_torque_fault"] == 0.02
        assert found["limited"] == 0.0
    assert told(found) == [
        "valid estimates: clutch 1 99.0 %, clutch 2 97.0 %, output 97.0 %",
        "share of estimates with: engine torque fault 2 %",
    ]
    assert told(StatusShares().as_json()) == ["valid estimates: clutch 1 0.0 %, clutch 2 0.0 %, output 0.0 %"]
