"""For which share of the estimates each torque was valid."""

import numpy as np

from dctorque_can.analysis.status_shares import BOTH_CLUTCHES, StatusShares
from dctorque_can.pipeline.estimates import Status


def test_valid_is_what_has_both_clutch_torques() -> None:
    shares = StatusShares()
    status = [0, Status.CLUTCH1_VALID, Status.CLUTCH1_VALID | Status.CLUTCH2_VALID, 0xFFFF]
    shares.count(np.arange(4), np.array(status, np.uint32))
    assert shares.having(BOTH_CLUTCHES) == 2


def test_shares_of_the_status_are_those_of_all_estimates_however_they_come():
    """97 estimates with all valid, 2 with a fault of the engine torque and clutch 1 alone, 1 with nothing."""
    everything = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID | Status.CONVERGED
    faulty = Status.CLUTCH1_VALID | Status.ENGINE_TORQUE_FAULT
    status = np.array([*97 * [everything], faulty, 0, faulty], np.uint32)
    t_us = 1000 * np.arange(100)
    for size in (1, 7, 100):
        shares = StatusShares()
        shares.count(t_us[:0], status[:0])
        for first in range(0, len(status), size):
            shares.count(t_us[first : first + size], status[first : first + size])
        assert shares.estimates == 100
        assert shares.having(everything) == 97
        found = shares.as_json()
        assert found["clutch1_valid"] == 0.99
        assert found["clutch2_valid"] == found["output_valid"] == 0.97
        assert found["engine_torque_fault"] == 0.02
        assert found["limited"] == 0.0


def test_a_fault_counts_for_the_time_that_it_stands():
    """Ten estimates within 1 ms, every 20 ms: the fault is in the last of each, and stands for 19.1 ms."""
    burst = np.arange(10) * 100
    t_us = (np.arange(30)[:, None] * 20_000 + burst).ravel()
    fault = np.uint32(Status.SHAFT1_SPEED_FAULT)
    status = np.where(np.arange(300) % 10 == 9, fault, np.uint32(0)).astype(np.uint32)
    for size in (1, 70, 300):
        shares = StatusShares()
        for first in range(0, 300, size):
            shares.count(t_us[first : first + size], status[first : first + size])
        assert shares.as_json()["shaft1_speed_fault"] == 0.1
        stood = 29 * 19_100 / (29 * 20_000 + 900)  # nobody knows how long the last one does
        assert shares.time_as_json()["shaft1_speed_fault"] == round(stood, 6)


def test_a_gap_and_a_step_back_of_the_clock_count_for_little():
    """The fault stands for 50 ms, then for a gap that counts as 100 ms, then the clock is set back."""
    shares = StatusShares()
    fault = int(Status.LIMITED)
    t_us = np.array([0, 150_000, 200_000, 5_000_000, 4_000_000, 4_100_000])
    shares.count(t_us, np.array([0, fault, fault, fault, 0, 0], np.uint32))
    assert shares.time_as_json()["limited"] == 0.428571  # 150 of 350 ms
