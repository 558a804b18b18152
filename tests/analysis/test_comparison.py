"""Each figure against a closed form, or against scipy."""

import numpy as np
import pytest
from scipy import signal, stats

from dctorque_can.analysis.comparison import judge, shift_windows
from dctorque_can.analysis.consistency import LEVELS, bands, independent_samples, mean_limits, nees, nis
from dctorque_can.analysis.errors import TORQUES, compare
from dctorque_can.analysis.lag import Stretch, lag_s
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.estimates import ESTIMATE, HEALTH

TRUTH = np.dtype(
    [
        ("t_us", "i8"),
        *((field, "f8") for field in TORQUES.values()),
        ("gear1", "i1"),
        ("gear2", "i1"),
        ("phase1", "u1"),
        ("phase2", "u1"),
    ]
)
START_US = 1_704_067_200_000_000


def every_row(n: int) -> np.ndarray:
    return np.ones(n, np.bool_)


# Lag


def sine(t_s: np.ndarray) -> np.ndarray:
    return 50 * np.sin(2 * np.pi * 0.8 * t_s) + 20 * np.sin(2 * np.pi * 1.7 * t_s)


def step_with_ramp(t_s: np.ndarray) -> np.ndarray:
    return np.clip((t_s - 1.0) * 400, 0.0, 120.0)


@pytest.mark.parametrize("wave", [sine, step_with_ramp])
@pytest.mark.parametrize("lag", [-0.0437, 0.0, 0.0005, 0.0213, 0.095])
def test_the_lag_of_a_shifted_signal(wave, lag: float) -> None:
    """Neither a bias nor the time between estimates matters."""
    truth_t = np.arange(0, 4.0005, 0.001)
    for period in (0.001, 0.0137):
        t = np.arange(0, 4, period)
        found = lag_s([Stretch(t, wave(t - lag) + 7.0, truth_t, wave(truth_t))])
        assert found == pytest.approx(lag, abs=1e-4)


def test_the_lag_of_a_low_pass_is_its_phase_over_its_frequency() -> None:
    """A filter with time constant T delays a sine of angular frequency w by atan(w T)/w."""
    omega, constant = 2 * np.pi, 0.03
    t = np.arange(0, 6.0005, 0.001)
    gain, phase = 1 / np.hypot(1, omega * constant), np.arctan(omega * constant)
    found = lag_s([Stretch(t, gain * np.sin(omega * t - phase), t, np.sin(omega * t))])
    assert found == pytest.approx(phase / omega, abs=5e-4)


def test_every_stretch_has_a_bias_of_its_own() -> None:
    t = np.arange(0, 6.0005, 0.001)
    halves = [(t < 3, 100.0), (t >= 3, -100.0)]
    parts = [Stretch(t[rows], sine(t[rows] - 0.02) + bias, t, sine(t)) for rows, bias in halves]
    assert lag_s(parts) == pytest.approx(0.02, abs=1e-4)


def test_no_lag_where_none_can_be_told() -> None:
    t = np.arange(0, 2.0005, 0.001)
    noise = np.random.default_rng(1).normal(size=len(t))
    assert lag_s([Stretch(t, noise, t, np.full(len(t), 30.0))]) is None  # the truth never changes
    assert lag_s([Stretch(t, sine(t - 0.3), t, sine(t))]) is None  # far beyond the range
    assert lag_s([Stretch(t[:50], sine(t[:50]), t, sine(t))]) is None  # no margin
    assert lag_s([]) is None


# Bands


def test_the_coverage_of_gaussian_errors_is_the_nominal_one() -> None:
    rng = np.random.default_rng(2)
    sigma = rng.uniform(0.5, 20, 200_000)
    found = bands(sigma * rng.normal(size=len(sigma)), sigma)
    assert found is not None
    for level, share in zip(LEVELS, found.coverage, strict=True):
        assert share == pytest.approx(level, abs=4 * np.sqrt(level * (1 - level) / len(sigma)))
    wrong = bands(2 * sigma * rng.normal(size=len(sigma)), sigma)  # errors of twice the stated size
    assert wrong is not None
    for level, share in zip(LEVELS, wrong.coverage, strict=True):
        within = 2 * stats.norm.cdf(stats.norm.ppf((1 + level) / 2) / 2) - 1
        assert share == pytest.approx(within, abs=0.005)
    assert wrong.log_score > found.log_score


def test_the_log_score_is_that_of_scipy() -> None:
    rng = np.random.default_rng(3)
    error, sigma = rng.normal(size=50), rng.uniform(0.1, 3, 50)
    found = bands(error, sigma)
    assert found is not None
    assert found.log_score == pytest.approx(-stats.norm.logpdf(error, scale=sigma).mean())


@pytest.mark.parametrize("nothing", [np.nan, 0.0])
def test_rows_that_state_nothing_do_not_count(nothing: float) -> None:
    found = bands(np.array([9.0, 0.1, 1.0]), np.array([nothing, 1.0, 1.0]))
    assert found is not None
    assert (found.samples, found.coverage) == (2, (0.5, 1.0, 1.0))
    assert bands(np.ones(3), np.full(3, nothing)) is None


# NEES


def correlated_pairs(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors drawn from the covariances that stand beside them."""
    sigma, correlation = rng.uniform(0.5, 8, (n, 2)), rng.uniform(-0.95, 0.95, n)
    white = rng.normal(size=(n, 2))
    second = correlation * white[:, 0] + np.sqrt(1 - correlation**2) * white[:, 1]
    return sigma * np.stack([white[:, 0], second], axis=1), sigma, correlation


def test_the_nees_of_gaussian_errors() -> None:
    error, sigma, correlation = correlated_pairs(40_000, np.random.default_rng(4))
    found = nees([(error, sigma, correlation, every_row(len(error)))])
    assert found is not None
    assert found.mean == pytest.approx(2.0, abs=4 * 2 / np.sqrt(len(error)))  # its variance is 4
    assert found.independent_samples > 0.9 * len(error)
    assert found.low < found.mean < found.high


def test_nees_and_log_score_are_those_of_the_inverted_matrix() -> None:
    error, sigma, correlation = correlated_pairs(30, np.random.default_rng(5))
    found = nees([(error, sigma, correlation, every_row(30))])
    assert found is not None
    squares, scores = [], []
    for e, s, r in zip(error, sigma, correlation, strict=True):
        covariance = np.array([[s[0] ** 2, r * s[0] * s[1]], [r * s[0] * s[1], s[1] ** 2]])
        squares.append(e @ np.linalg.inv(covariance) @ e)
        scores.append(-stats.multivariate_normal.logpdf(e, cov=covariance))
    assert found.mean == pytest.approx(np.mean(squares))
    assert found.log_score == pytest.approx(np.mean(scores))


def test_drives_are_taken_together_and_rows_without_a_covariance_left_out() -> None:
    rng = np.random.default_rng(6)
    drives = [(*correlated_pairs(50, rng), every_row(50)) for _ in range(2)]
    together = nees(drives)
    alone = [nees([drive]) for drive in drives]
    assert together is not None
    assert together.mean == pytest.approx(np.mean([one.mean for one in alone if one is not None]))
    error, sigma, correlation, rows = drives[0]
    sigma[:10, 1], correlation[10:20] = 0.0, 1.0
    partly = nees([(error, sigma, correlation, rows)])
    assert partly is not None
    assert partly.samples == 30
    assert nees([(error, np.zeros((50, 2)), correlation, rows)]) is None
    sigma[:10, 1], correlation[10:20], correlation[20:25] = np.nan, 1.0, np.nan
    less = nees([(error, sigma, correlation, rows)])
    assert less is not None
    assert less.samples == 25
    assert less.mean == pytest.approx(nees([(error[25:], sigma[25:], correlation[25:], rows[25:])]).mean)  # type: ignore[union-attr]
    assert nees([(error, np.full((50, 2), np.nan), np.full(50, np.nan), rows)]) is None


@pytest.mark.parametrize("count", [1.0, 7.5, 93.0, 5000.0])
def test_the_limits_are_quantiles_of_chi_square(count: float) -> None:
    for freedom in (1, 2):
        expected = stats.chi2.ppf([0.025, 0.975], freedom * count) / count
        assert mean_limits(count, freedom) == pytest.approx(tuple(expected))


# NIS


def innovations(*samples: int, scale: float = 1.0) -> np.ndarray:
    """Return the last health records of drives with so many normal innovations of the engine speed."""
    rng = np.random.default_rng(10)
    rows = np.zeros(len(samples), HEALTH)
    for row, n in zip(rows, samples, strict=True):
        row["innovations"][0] = n
        row["innovation_squares"][0] = np.sum((scale * rng.normal(size=n)) ** 2)
        row["innovations_rejected"][0] = 2
    return rows


def test_the_nis_of_normal_innovations_is_one() -> None:
    found = nis(innovations(3000, 5000))
    assert list(found) == ["engine"]  # the others gave nothing
    engine = found["engine"]
    assert (engine.samples, engine.rejected) == (8000, 4)
    low, high = engine.limits
    assert low < engine.mean < high
    assert (low, high) == pytest.approx(tuple(stats.chi2.interval(0.95, 8000) / np.array(8000.0)))
    assert nis(innovations(3000, scale=1.1))["engine"].mean > high
    assert nis(innovations(3000, scale=0.9))["engine"].mean < low
    assert nis(np.zeros(2, HEALTH)) == {}


def test_every_sensor_has_its_place() -> None:
    row = np.zeros(1, HEALTH)
    row["innovations"], row["innovation_squares"] = 10, [5.0, 10.0, 15.0, 20.0, 25.0]
    assert {name: found.mean for name, found in nis(row).items()} == {
        "engine": 0.5,
        "shaft1": 1.0,
        "shaft2": 1.5,
        "driven_wheels": 2.0,
        "undriven_wheels": 2.5,
    }


# Independent samples


def first_order(n: int, rho: float, rng: np.random.Generator) -> np.ndarray:
    return signal.lfilter([1.0], [1.0, -rho], rng.normal(size=n + 1000))[1000:]


@pytest.mark.parametrize("rho", [0.5, 0.9, 0.98])
def test_independent_samples_of_a_first_order_process(rho: float) -> None:
    """Σ ρ^k is a geometric series: n / (1 + 2 ρ/(1-ρ)) = n (1-ρ)/(1+ρ)."""
    n = 200_000
    x = first_order(n, rho, np.random.default_rng(7))
    expected = n * (1 - rho) / (1 + rho)
    assert independent_samples([(x, every_row(n))]) == pytest.approx(expected, rel=0.15)


def test_gaps_do_not_change_the_correlation() -> None:
    n, rho = 200_000, 0.9
    rng = np.random.default_rng(8)
    rows = np.arange(n) % 1000 < 600
    series = [(first_order(n, rho, rng), rows), (first_order(n, rho, rng), rows)]
    expected = 2 * rows.sum() * (1 - rho) / (1 + rho)
    assert independent_samples(series) == pytest.approx(expected, rel=0.15)


def test_independent_samples_are_between_one_and_all() -> None:
    n = 1000
    assert independent_samples([(np.full(n, 3.0), every_row(n))]) == n
    assert independent_samples([(np.resize([1.0, -1.0], n), every_row(n))]) == n
    assert 1.0 <= independent_samples([(np.linspace(0, 1, n), every_row(n))]) < 10


def test_the_limits_hold_the_mean_nees_of_correlated_errors_as_often_as_they_say() -> None:
    """Many drives of an honest estimator whose errors last; limits for n independent samples are a joke."""
    rng = np.random.default_rng(9)
    n, rho = 4000, 0.97
    inside = naive = 0
    for _ in range(300):
        error = np.stack([first_order(n, rho, rng) for _ in range(2)], axis=1) * np.sqrt(1 - rho**2)
        found = nees([(error, np.ones((n, 2)), np.zeros(n), every_row(n))])
        assert found is not None
        inside += found.low < found.mean < found.high
        low, high = mean_limits(n, 2)
        naive += low < found.mean < high
    assert inside / 300 > 0.88
    assert naive / 300 < 0.5


# A whole comparison


def drive(lag: float = 0.02, bias: float = 3.0, sigma: float = np.nan) -> tuple[np.ndarray, np.ndarray]:
    """Return estimates and truth of 6 s in which clutch 1 hands over to clutch 2 from 2.0 to 2.5 s."""
    truth = np.zeros(6001, TRUTH)
    t_s = np.arange(6001) / 1000
    truth["t_us"] = START_US + np.arange(6001) * 1000
    truth["gear1"], truth["gear2"] = 1, 2
    truth["phase1"] = np.where(t_s < 2.0, ClutchPhase.LOCKED, np.where(t_s < 2.4, ClutchPhase.SLIPPING, 0))
    truth["phase2"] = np.where(t_s < 2.0, 0, np.where(t_s < 2.5, ClutchPhase.SLIPPING, ClutchPhase.LOCKED))
    rows = np.zeros(600, ESTIMATE)
    rows["t_us"] = START_US + np.arange(600) * 10_000
    for field in TORQUES.values():
        truth[field] = sine(t_s)
        rows[field] = sine((rows["t_us"] - START_US) / 1e6 - lag) + bias
    for name in ("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm"):
        rows[name] = sigma
    rows["clutch_correlation"] = 0.0 * sigma
    return rows, truth


def test_windows_are_the_shifts_and_100_ms_around() -> None:
    _, truth = drive()
    assert (shift_windows(truth) - START_US).tolist() == [[1_900_000, 2_600_000]]
    assert shift_windows(truth[:1000]).shape == (0, 2)


def test_figures_of_two_drives() -> None:
    rows, truth = drive()
    found = judge([(rows, truth), (rows, truth)])
    known = compare(rows, truth)
    assert found.everything.samples == 1200
    assert found.shifts is not None
    assert found.shifts.samples == 2 * 71
    for name in TORQUES:
        torque = found.everything.torques[name]
        assert torque.rms_nm == pytest.approx(known[name].rms)
        assert torque.bias_nm == pytest.approx(known[name].bias)
        assert torque.peak_nm == pytest.approx(known[name].peak)
        assert torque.bands is None
        for figures in (found.everything, found.shifts):
            assert figures.torques[name].lag_ms == pytest.approx(20, abs=0.2)
    assert found.everything.clutches is None


def test_every_drive_has_its_own_rms() -> None:
    """Errors of 3 and 4 N·m; the second drive ends before its shift."""
    one, (rows, truth) = drive(lag=0.0), drive(lag=0.0, bias=4.0)
    found = judge([one, (rows, truth[:1000])], lag=False)
    torque = found.everything.torques["clutch2_nm"]
    assert torque.rms_each_nm == (pytest.approx(3.0, abs=1e-3), pytest.approx(4.0, abs=1e-3))
    assert torque.rms_nm == pytest.approx(np.sqrt((600 * 9 + 100 * 16) / 700), abs=1e-3)
    assert torque.lag_ms is None
    assert found.shifts is not None
    assert found.shifts.torques["clutch2_nm"].rms_each_nm == (pytest.approx(3.0, abs=1e-3), None)


def test_stated_deviations_are_judged() -> None:
    found = judge([drive(lag=0.0, bias=3.0, sigma=2.0)])
    for figures in (found.everything, found.shifts):
        assert figures is not None
        band = figures.torques["output_nm"].bands
        assert band is not None
        assert band.coverage == (0.0, 1.0, 1.0)  # always 1.5 σ off; the bands are ±0.67, ±1.64 and ±1.96 σ
        assert figures.clutches is not None
        assert figures.clutches.mean == pytest.approx(2 * 1.5**2, rel=1e-4)


def test_a_drive_without_shifts_and_one_without_anything() -> None:
    rows, truth = drive()
    assert judge([(rows, truth[:1000])]).shifts is None
    with pytest.raises(DctorqueError, match="nothing to compare"):
        judge([(rows[:0], truth)])
    with pytest.raises(DctorqueError, match="nothing to compare"):
        judge([(rows, truth[:0])])
