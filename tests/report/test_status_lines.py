"""How often each torque was valid, in words."""

import numpy as np

from dctorque_can.analysis.status_shares import StatusShares
from dctorque_can.pipeline.estimates import Status
from dctorque_can.report.status_lines import status_lines


def test_faults_are_told_only_above_one_percent():
    both = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID
    faulty = Status.CLUTCH1_VALID | Status.ENGINE_TORQUE_FAULT
    shares = StatusShares()
    t_us = 1000 * np.array([*range(97), 97, 98, 99, 100])
    shares.count(t_us, np.array([*97 * [both], faulty, faulty, Status.LIMITED, 0], np.uint32))
    assert status_lines(shares.as_json(), shares.time_as_json()) == [
        "valid estimates: clutch 1 98.0 % (99.0 % of the time), clutch 2 96.0 % (97.0 % of the time), "
        "output shaft 0.0 % (0.0 % of the time)",
        "share of the time with: engine torque fault 2 %",
    ]


def test_without_estimates_nothing_is_valid():
    nothing = StatusShares()
    (line,) = status_lines(nothing.as_json(), nothing.time_as_json())
    assert line.count("0.0 % (0.0 % of the time)") == 3
