"""How long the traffic of a recording is."""

import numpy as np
import pytest

from dctorque_can.offline.traffic_time import TrafficTime

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
