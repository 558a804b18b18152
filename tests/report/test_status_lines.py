"""How often each torque was valid, in words."""

import numpy as np

from dctorque_can.analysis.status_shares import StatusShares
from dctorque_can.pipeline.estimates import Status
from dctorque_can.report.status_lines import status_lines


def test_faults_are_told_only_above_one_percent():
    both = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID
    faulty = Status.CLUTCH1_VALID | Status.ENGINE_TORQUE_FAULT
    shares = StatusShares()
    shares.count(np.array([*97 * [both], faulty, faulty, Status.LIMITED], np.uint32))
    assert status_lines(shares.as_json()) == [
        "valid estimates: clutch 1 99.0 %, clutch 2 97.0 %, output shaft 0.0 %",
        "share of estimates with: engine torque fault 2 %",
    ]


def test_without_estimates_nothing_is_valid():
    lines = status_lines(StatusShares().as_json())
    assert lines == ["valid estimates: clutch 1 0.0 %, clutch 2 0.0 %, output shaft 0.0 %"]
