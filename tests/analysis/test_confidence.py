"""Confidently wrong: valid, beyond 5 σ, and beyond what harms nobody."""

import numpy as np
import pytest

from dctorque_can.analysis.comparison import judge
from dctorque_can.analysis.confidence import lasting_ms, wrong
from dctorque_can.pipeline.estimates import ESTIMATE, Status
from dctorque_can.simulation.truth import TRUTH

BITS = {"clutch1_nm": Status.CLUTCH1_VALID, "clutch2_nm": Status.CLUTCH2_VALID, "output_nm": Status.OUTPUT_VALID}


@pytest.mark.parametrize(("name", "least"), [("clutch1_nm", 10.0), ("clutch2_nm", 10.0), ("output_nm", 100.0)])
def test_what_is_wrong(name, least):
    above, own = 1.01 * least, int(BITS[name])
    others = int(Status.CLUTCH1_VALID | Status.CLUTCH2_VALID | Status.OUTPUT_VALID) & ~own
    cases = [  # error, σ, status, wrong
        (above, above / 5.01, own, True),
        (-above, above / 5.01, own, True),
        (above, above / 4.99, own, False),  # as unsure as it should be
        (0.99 * least, 0.01, own, False),  # small
        (above, 0.01, others, False),  # not called valid
        (above, np.nan, own, False),  # no σ is stated
    ]
    error, sigma, status, expected = (np.array(column) for column in zip(*cases, strict=True))
    np.testing.assert_array_equal(wrong(name, error, sigma, status.astype(np.uint32)), expected)


def test_an_estimate_stands_until_the_next_but_not_through_a_gap():
    np.testing.assert_allclose(lasting_ms(np.array([0, 1000, 11_000, 5_000_000, 5_002_000])), [1, 10, 100, 2, 2])
    assert lasting_ms(np.array([7])).tolist() == [0.0]
    assert lasting_ms(np.zeros(0, np.int64)).tolist() == []


def test_a_comparison_adds_up_the_time_of_all_drives():
    """Each drive has 200 estimates every 10 ms, of which 30 of clutch 2 are 20 N·m off with a σ of 1 N·m."""
    truth = np.zeros(2001, TRUTH)
    truth["t_us"] = 1000 * np.arange(2001)
    rows = np.zeros(200, ESTIMATE)
    rows["t_us"] = 10_000 * np.arange(200)
    rows["status"] = int(BITS["clutch2_nm"])
    for name in ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm"):
        rows[name] = 1.0
    rows["clutch2_torque_nm"][50:80] = 20.0
    rows["clutch1_torque_nm"][50:80] = 20.0  # is not called valid
    found = judge([(rows, truth), (rows, truth)], lag=False).everything.torques
    assert found["clutch2_nm"].wrong_ms == pytest.approx(600.0)
    assert found["clutch1_nm"].wrong_ms == found["output_nm"].wrong_ms == 0.0
    for name in ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm", "clutch_correlation"):
        rows[name] = np.nan
    assert judge([(rows, truth)], lag=False).everything.torques["clutch2_nm"].wrong_ms is None
