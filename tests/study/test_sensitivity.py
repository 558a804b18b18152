"""The sensitivity against functions whose first-order indices are known in closed form."""

import numpy as np
import pytest
from scipy.stats import qmc

from dctorque_can.study.sensitivity import fewest_runs, sensitivity


def sample(n: int, d: int, seed: int = 3) -> np.ndarray:
    """Return ``[n, d]`` evenly in -1 .. 1."""
    return 2.0 * qmc.Sobol(d, scramble=True, seed=np.random.default_rng(seed)).random(n) - 1.0


def test_indices_and_ranges_of_parabolas_and_lines() -> None:
    """Var(a x) = a²/3, Var(b x²) = 4 b²/45 over -1 .. 1; from the 5 to the 95 % quantile x is -0.9 .. 0.9."""
    x = sample(512, 4)
    found = sensitivity(x, 5.0 + 2.0 * x[:, 0] + 3.0 * x[:, 1] ** 2, seed=1)
    total = 4.0 / 3.0 + 0.8
    shares = [effect.share for effect in found.effects]
    np.testing.assert_allclose(shares, [4.0 / 3.0 / total, 0.8 / total, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(
        [effect.change for effect in found.effects], [3.6, 3.0 * 0.81, 0.0, 0.0], rtol=0.01, atol=1e-9
    )
    assert found.explained == pytest.approx(1.0)
    assert [effect.shape for effect in found.effects[:2]] == ["↑", "∪"]
    assert sensitivity(x, -x[:, 0] - x[:, 1] ** 2, seed=1).effects[0].shape == "↓"
    assert sensitivity(x, -x[:, 0] - x[:, 1] ** 2, seed=1).effects[1].shape == "∩"


def test_a_v_is_seen_although_its_slope_is_zero() -> None:
    """Over -1 .. 1 a parabola takes 15/16 of the variance of |x|: (√5/8)² / (1/12)."""
    x = sample(1024, 3)
    found = sensitivity(x, np.abs(x[:, 1]), seed=1)
    assert found.effects[1].share == pytest.approx(15 / 16, abs=0.01)
    assert [effect.significant for effect in found.effects] == [False, True, False]


def test_interactions_are_left_to_the_rest() -> None:
    x = sample(1024, 3)
    found = sensitivity(x, x[:, 0] + x[:, 1] * x[:, 2], seed=1)  # Var = 1/3 + 1/9
    assert found.effects[0].share == pytest.approx(0.75, abs=0.02)
    assert found.explained == pytest.approx(0.75, abs=0.02)
    assert [effect.significant for effect in found.effects] == [True, False, False]


def test_chance_is_called_so() -> None:
    """One study in twenty may find something in pure noise: 2 of 40 are expected, 7 would be a scandal."""
    random = np.random.default_rng(5)
    false = 0
    for seed in range(40):
        noise = random.standard_normal(128)
        false += any(effect.significant for effect in sensitivity(sample(128, 10, seed), noise, seed).effects)
    assert false < 7


def test_confidence_covers_the_truth() -> None:
    random = np.random.default_rng(6)
    covered = 0
    for seed in range(40):
        x = sample(128, 5, seed)
        effect = sensitivity(x, 2.0 * x[:, 2] + random.standard_normal(128), seed).effects[2]
        covered += effect.low <= 3.6 <= effect.high
    assert covered >= 30  # of 36 that are expected


def test_the_scale_of_a_factor_does_not_matter() -> None:
    x = sample(128, 2)
    y = np.random.default_rng(2).standard_normal(128) + x[:, 0]
    one, other = sensitivity(x, y, seed=1), sensitivity(x * [1e-6, 1e5] + [3e-6, 7.0], y, seed=1)
    for a, b in zip(one.effects, other.effects, strict=True):
        assert b.change == pytest.approx(a.change, rel=1e-9)
    assert sensitivity(x, np.full(128, 3.0), seed=1).effects[0].share == 0.0


def test_fewest_runs() -> None:
    assert fewest_runs(20) == 82
