"""What a run or a replay amounted to."""

import numpy as np
import pytest

from dctorque_can.config.load import Config
from dctorque_can.daemon.summary import TrafficTime, count_valid, doubts, never_received
from dctorque_can.pipeline.estimates import ESTIMATE, HEALTH, Status
from dctorque_can.pipeline.samples import Quantity

SECOND = 1_000_000


@pytest.mark.parametrize(
    ("times_s", "seconds"),
    [
        ([], 0),
        ([5], 0),
        ([5, 6, 9], 4),
        ([5, 6, 5.9, 7], 2),  # two channels, a little out of order
        ([100, 90], 0),
        ([100, 110, 3, 8], 15),
        ([3, 8, 1_700_000_000, 1_700_000_002, 4, 5], 1_700_000_000),
        ([9, 1, 9, 1], 8),
    ],
)
@pytest.mark.parametrize("cut", [1, 2, 10])
def test_a_step_back_of_the_clock_takes_no_time_away(times_s: list[float], seconds: float, cut: int) -> None:
    time = TrafficTime()
    t_us = np.array([round(t * SECOND) for t in times_s], np.int64)
    for start in range(0, len(t_us), cut):
        time.take(t_us[start : start + cut])
    assert time.seconds == seconds


def test_inputs_that_never_came(config: Config) -> None:
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
