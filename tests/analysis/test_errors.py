import numpy as np
import pytest

from dctorque_can.analysis.errors import TORQUES, compare
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.estimates import ESTIMATE

FIELDS = tuple(TORQUES.values())


def truth(t_us: list[int], value: list[float]) -> np.ndarray:
    rows = np.zeros(len(t_us), [("t_us", "i8"), *((field, "f8") for field in FIELDS)])
    rows["t_us"] = t_us
    for field in FIELDS:
        rows[field] = value
    return rows


def estimates(t_us: list[int], value: list[float]) -> np.ndarray:
    rows = np.zeros(len(t_us), ESTIMATE)
    rows["t_us"] = t_us
    for field in FIELDS:
        rows[field] = value
    return rows


def test_figures_of_a_case_worked_by_hand() -> None:
    """The truth rises by 1 per ms; the errors are +3, 0 and -4: rms sqrt(25/3), mean -1/3."""
    base = 1_704_067_200_000_000
    ramp = truth([base, base + 10_000], [0.0, 10.0])
    found = compare(estimates([base, base + 2_500, base + 5_000], [3.0, 2.5, 1.0]), ramp)
    for name in TORQUES:
        assert found[name].rms == pytest.approx((25 / 3) ** 0.5)
        assert found[name].bias == pytest.approx(-1 / 3)
        assert found[name].peak == pytest.approx(4.0)
        assert found[name].peak_t_us == base + 5_000


def test_estimates_outside_the_truth_do_not_count() -> None:
    found = compare(estimates([0, 5, 99], [100.0, 1.0, 100.0]), truth([1, 10], [1.0, 1.0]))
    assert found["clutch1_nm"].peak == 0.0


@pytest.mark.parametrize("t_us", [[], [99]])
def test_nothing_in_common_is_one_clear_error(t_us: list[int]) -> None:
    with pytest.raises(DctorqueError, match="nothing to compare"):
        compare(estimates(t_us, [0.0] * len(t_us)), truth([1, 10], [0.0, 0.0]))
    with pytest.raises(DctorqueError, match="nothing to compare"):
        compare(estimates([1], [0.0]), truth([], []))
