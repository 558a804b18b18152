"""Regression with beliefs against closed forms and drawn data."""

import numpy as np
import pytest

from dctorque_can.identify.beliefs import shared
from dctorque_can.identify.equations import Equations
from dctorque_can.identify.regression import Belief, log_likelihood, solve


def drawn(seed: int, n: int = 4000, noise: float = 0.5, walk: float = 0.0, every_s: float = 0.2) -> Equations:
    """Return y = 3 a − 2 b + noise + walk, with a and b drawn."""
    random = np.random.default_rng(seed)
    a, b = random.standard_normal(n), random.standard_normal(n)
    steps = walk * np.sqrt(every_s) * random.standard_normal(n)
    y = 3.0 * a - 2.0 * b + noise * random.standard_normal(n) + np.cumsum(steps)
    return Equations("car", every_s * np.arange(n), y, {"a": a, "b": b}, walks=walk > 0.0)


def test_wide_beliefs_give_least_squares() -> None:
    equations = drawn(1)
    found = solve([equations], {"a": Belief(0.0, 1e3), "b": Belief(0.0, 1e3)})
    x = np.stack([equations.columns["a"], equations.columns["b"]], axis=1)
    usual = np.linalg.lstsq(x, equations.y, rcond=None)[0]
    assert found.values == pytest.approx(usual, abs=0.01)  # far residuals count less here
    assert found.of("a").sigma == pytest.approx(0.5 / np.sqrt(4000), rel=0.3)


def test_a_sure_belief_stays() -> None:
    found = solve([drawn(2)], {"a": Belief(1.0, 1e-6), "b": Belief(0.0, 1e3)})
    assert found.of("a").value == pytest.approx(1.0, abs=1e-4)
    assert found.of("b").value == pytest.approx(-2.0, abs=0.3)


def test_what_no_equation_holds_is_left_out() -> None:
    found = solve([drawn(3)], {"a": Belief(0.0, 10.0), "b": Belief(0.0, 10.0), "c": Belief(5.0, 1.0)})
    assert found.names == ["a", "b"]


def test_a_walk_is_filtered_out() -> None:
    beliefs = {"a": Belief(0.0, 1e3), "b": Belief(0.0, 1e3)}
    errors = []
    for seed in range(20):
        found = solve([drawn(seed, 1000, walk=5.0)], beliefs)
        errors.append((found.of("a").value - 3.0) / found.of("a").sigma)
    assert np.std(errors) < 1.5
    assert found.of("a").sigma < 0.15  # plain least squares would leave the walk, of some 70 in the end


def test_errors_that_hang_together_make_less_sure() -> None:
    """Each of these equations stands there ten times."""
    once = drawn(5, 400, every_s=2.0)
    many = Equations(
        "car",
        np.repeat(once.t_s, 10) + np.tile(0.01 * np.arange(10), 400),
        np.repeat(once.y, 10),
        {name: np.repeat(column, 10) for name, column in once.columns.items()},
    )
    beliefs = {"a": Belief(0.0, 1e3), "b": Belief(0.0, 1e3)}
    assert solve([many], beliefs).of("a").sigma == pytest.approx(solve([once], beliefs).of("a").sigma, rel=0.35)


def test_such_equations_do_not_outweigh_what_was_believed() -> None:
    once = drawn(6, 60, noise=3.0, every_s=2.0)
    many = Equations(
        "car",
        np.repeat(once.t_s, 20) + np.tile(0.01 * np.arange(20), 60),
        np.repeat(once.y, 20),
        {name: np.repeat(column, 20) for name, column in once.columns.items()},
    )
    beliefs = {"a": Belief(1.0, 0.4), "b": Belief(-2.0, 1e-3)}
    one, other = (solve([each], beliefs).of("a").value for each in (once, many))
    assert other == pytest.approx(one, abs=0.35)
    assert other < 2.9


def test_a_number_that_is_considered_moves_nothing_and_makes_less_sure() -> None:
    random = np.random.default_rng(7)
    a = random.standard_normal(1000)
    equations = Equations(
        "car", 0.2 * np.arange(1000), a + 0.1 * random.standard_normal(1000), {"scale": a, "gain": a}
    )
    found = solve([equations], {"scale": Belief(0.0, 10.0), "gain": Belief(0.0, 1e-5)})
    wider = found.considering("gain", 0.05)
    assert wider.values == pytest.approx(found.values)
    assert wider.of("scale").sigma == pytest.approx(0.05, rel=0.05)
    assert wider.correlation("scale", "gain") == pytest.approx(-1.0, abs=0.01)


def test_given_one_number_the_others_follow() -> None:
    random = np.random.default_rng(8)
    a = random.standard_normal(500)
    equations = Equations("car", 0.2 * np.arange(500), a + 0.01 * random.standard_normal(500), {"p": a, "q": a})
    found = solve([equations], {"p": Belief(0.0, 1.0), "q": Belief(0.0, 1.0)})
    assert sum(found.values) == pytest.approx(1.0, abs=0.01)
    assert found.given("p", 0.9)["q"] == pytest.approx(0.1, abs=0.01)


def test_right_numbers_are_likelier() -> None:
    fitted = solve([drawn(9, walk=1.0)], {"a": Belief(0.0, 1e3), "b": Belief(0.0, 1e3)})
    held = [drawn(10, walk=1.0)]
    right = log_likelihood(held, {"a": 3.0, "b": -2.0}, fitted)
    assert right > log_likelihood(held, {"a": 3.1, "b": -2.0}, fitted)
    assert right > log_likelihood(held, {"a": 3.0, "b": -1.9}, fitted)


def test_a_sum_is_shared_by_how_unsure_its_parts_were() -> None:
    """Of 10 ± 3 and 5 ± 4 the sum is 20 exactly: both errors have the sum 5, in the shares 9 and 16 of 25."""
    one, two = shared(Belief(20.0, 0.0), [Belief(10.0, 3.0), Belief(5.0, 4.0)])
    assert (one.value, two.value) == pytest.approx((11.8, 8.2))
    assert one.sigma == pytest.approx(3.0 * 4.0 / 5.0)  # σ₁ σ₂ / √(σ₁² + σ₂²)
    assert two.sigma == pytest.approx(one.sigma)
