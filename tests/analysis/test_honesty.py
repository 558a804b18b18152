"""What the word of an estimator is worth, on rows made by hand."""

import numpy as np
import pytest

from dctorque_can.analysis.honesty import honesty
from dctorque_can.pipeline.estimates import Status

FIELDS = ("clutch1", "clutch2", "output")
ROWS = np.dtype(
    [("t_us", "i8"), ("status", "u4"), *((f"{f}_{what}_nm", "f8") for f in FIELDS for what in ("torque", "sigma"))]
)


def test_by_hand() -> None:
    """A constant truth of 50 N·m; two stretches of errors, of which the second is not valid at its end."""
    truth = np.zeros(2, [("t_us", "i8"), *((f"{f}_torque_nm", "f8") for f in FIELDS)])
    truth["t_us"] = 1_000_000, 2_000_000
    rows = np.zeros(101, ROWS)
    rows["t_us"] = 1_000_000 + 10_000 * np.arange(101)
    rows["status"] = Status.CLUTCH1_VALID | Status.CLUTCH2_VALID
    for field in FIELDS:
        truth[f"{field}_torque_nm"] = rows[f"{field}_torque_nm"] = 50.0
        rows[f"{field}_sigma_nm"] = 2.0
    rows["clutch1_torque_nm"][20:23] += 12.0  # 30 ms, 6 σ
    rows["clutch1_torque_nm"][60:70] -= 20.0
    rows["clutch1_sigma_nm"][60] = 1.0
    rows["clutch1_torque_nm"][90] += 9.0  # 4.5 σ: not even a fault if it were more than 10 N·m
    rows["status"][65:70] = Status.CLUTCH2_VALID
    late = rows[-1:].copy()
    late["t_us"] = 2_500_000  # beyond the truth: not judged
    late["clutch2_torque_nm"] = 1e6
    found = honesty(np.concatenate([rows, late]), truth)

    one = found["clutch1_nm"]
    assert one.rows == 96
    assert one.valid == pytest.approx(96 / 101)
    assert one.wrong_ms == pytest.approx(30.0 + 50.0)
    assert one.rms_nm == pytest.approx(np.sqrt((3 * 144 + 5 * 400 + 81) / 96))
    assert one.held == pytest.approx((96 - 9) / 96)
    assert one.episode is not None
    assert (one.episode.start_s, one.episode.wrong_ms) == pytest.approx((0.6, 50.0))
    assert (one.episode.error_nm, one.episode.sigma_nm) == (-20.0, 1.0)
    two, never = found["clutch2_nm"], found["output_nm"]
    assert (two.rows, two.rms_nm, two.held, two.wrong_ms, two.episode) == (101, 0.0, 1.0, 0.0, None)
    assert (never.rows, never.valid, never.rms_nm, never.held, never.wrong_ms) == (0, 0.0, None, None, 0.0)
