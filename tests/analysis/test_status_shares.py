"""For which share of the estimates each torque was valid."""

import numpy as np

from dctorque_can.analysis.status_shares import BOTH_CLUTCHES, StatusShares
from dctorque_can.pipeline.estimates import Status


def test_valid_is_what_has_both_clutch_torques() -> None:
    shares = StatusShares()
    status = [0, Status.CLUTCH1_VALID, Status.CLUTCH1_VALID | Status.CLUTCH2_VALID, 0xFFFF]
    shares.count(np.array(status, np.uint32))
    assert shares.having(BOTH_CLUTCHES) == 2


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
