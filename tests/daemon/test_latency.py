"""The histogram of latencies: as good as its bins, of one size whatever comes."""

import sys
from random import Random

import numpy as np
import pytest

from dctorque_can.daemon.status.latency import LONGEST_S, PER_DECADE, PERIOD_S, Histogram, Latency


@pytest.mark.parametrize("share", [0.5, 0.99, 0.999])
def test_a_quantile_is_that_of_the_numbers_to_the_width_of_a_bin(share: float) -> None:
    chance = Random(1)
    times = [chance.lognormvariate(-7.0, 1.5) for _ in range(20_000)]
    histogram = Histogram()
    for seconds in times:
        histogram.add(seconds)
    true = float(np.quantile(times, share, method="inverted_cdf"))
    found = histogram.quantile_s(share)
    assert found is not None
    assert 1.0 <= found / true <= 10.0 ** (1 / PER_DECADE)
    assert histogram.longest_s == max(times)


def test_it_takes_everything_and_does_not_grow() -> None:
    histogram = Histogram()
    before = sys.getsizeof(histogram._bins)
    for seconds in (0.0, 1e-9, 1e-5, 1.0, 10.0, 59.0):
        histogram.add(seconds)
    assert histogram.count == 6
    assert histogram.quantile_s(0.0) == 1e-5
    assert histogram.quantile_s(1.0) == 59.0
    assert sys.getsizeof(histogram._bins) == before


def test_nothing_is_known_of_nothing() -> None:
    assert Histogram().quantile_s(0.5) is None
    assert Histogram().as_json()["p99_ms"] is None


def test_stamps_of_another_clock_are_counted_alone_and_minutes_follow_each_other() -> None:
    latency = Latency()
    latency.answered(0, 5_000)  # before the service runs
    latency.keep_time(10.0)
    for stamp_us in (1_000_000, 999_000, 1_000_001, -round(1e6 * LONGEST_S)):
        latency.answered(stamp_us, 1_000_000)
    latency.keep_time(10.0 + PERIOD_S - 0.1)
    assert latency.as_json()["last_minute"]["count"] == 0
    latency.keep_time(10.0 + PERIOD_S)
    latency.answered(0, 2_000)
    found = latency.as_json()
    assert (found["count"], found["foreign_clock"], found["last_minute"]["count"]) == (3, 2, 2)
    assert found["longest_ms"] == 2.0
    assert found["last_minute"]["longest_ms"] == 1.0
    assert found["sum_s"] == pytest.approx(0.003)
