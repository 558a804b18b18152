"""Poles, observability and Lyapunov function against other ways to them: finite differences, Gramians, runs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dctorque_can.config.load import load_config
from dctorque_can.estimators.oh2014 import model as oh2014_model
from dctorque_can.estimators.oh2014 import observer as oh2014
from dctorque_can.estimators.oh2014 import stability
from dctorque_can.estimators.oh2014.driving_conditions import (
    all_pairs,
    driving_conditions,
    full_engine_torque,
    neighbouring_pairs,
)
from dctorque_can.resources import shipped_config

CARS = {name: load_config(shipped_config(name)).settings for name in ("paper_car", "avante_dct7")}
CASES = [("paper_car", 1, 2), ("paper_car", 3, 2), ("avante_dct7", 5, 6)]


def observer(car, g1, g2, **design):
    settings = CARS[car]
    c, pair = stability.observer_records(settings.vehicle, replace(settings.observer, **design), g1, g2)
    return c, pair, stability.gains(c, pair)


def points(car, g1, g2):
    for q in driving_conditions(CARS[car].vehicle, g1, g2):
        yield q.engine_speed_rad_s, q.wheel_acceleration_rad_s2


@pytest.mark.parametrize(("car", "g1", "g2"), CASES)
def test_gains_are_those_of_the_running_observer(car, g1, g2):
    """By hand from the vehicle file, and as `set_pair` fills the record that the estimator uses."""
    settings = CARS[car]
    vehicle, design = settings.vehicle, settings.observer
    _, _, g = observer(car, g1, g2)
    constants = oh2014_model.constants(vehicle, design)
    pair = np.zeros(1, oh2014_model.PAIR)
    oh2014_model.set_pair(pair[0], constants[0], g1, g2)
    assert (g.g_e, g.g_t, g.g_l, g.L) == (
        pair["g_e"][0],
        pair["g_t"][0],
        constants["g_l"][0],
        constants["L"][0],
    )
    J_e = vehicle.engine_inertia_kgm2 + vehicle.damper.inertia_kgm2
    one, two = vehicle.gear(g1), vehicle.gear(g2)
    J_1 = vehicle.shafts[0].inertia_kgm2 + one.inertia_kgm2
    J_2 = vehicle.shafts[1].inertia_kgm2 + two.inertia_kgm2
    J_e1 = J_1 + J_2 * (two.total_ratio / one.total_ratio) ** 2
    p_e, p_s = design.engine_bandwidth_rad_s, design.shaft_bandwidth_rad_s
    assert (g.l_1, g.l_2, g.l_3, g.l_4) == pytest.approx((2 * p_e, p_e**2 * J_e, 2 * p_s, p_s**2 * J_e1))
    assert g.g_t == pytest.approx(one.total_ratio**2 / (design.adaptation_time_s * 25.0))


def jacobian(c, pair, w_e, a_w):
    """Finite differences of the implemented right-hand side; it is affine, so any step is exact to rounding."""
    scale = np.array([100, 100, 0.1, 100, 10, 100, 10, 100.0])
    point = (c, pair, w_e, 180.0, 120.0, a_w, 90.0)
    zero = oh2014.right_hand_side(np.zeros(8), *point)
    columns = [(oh2014.right_hand_side(s * e, *point) - zero) / s for s, e in zip(scale, np.eye(8), strict=True)]
    return np.array(columns).T


@pytest.mark.parametrize("printed", [True, False])
@pytest.mark.parametrize(("car", "g1", "g2"), CASES)
def test_poles_are_those_of_the_right_hand_side(car, g1, g2, printed):
    """The six of the core and -L twice, whatever rows 1 and 2 take from the core."""
    c, pair, g = observer(car, g1, g2, printed_rate_law=printed)
    for w_e, a_w in points(car, g1, g2):
        J = jacobian(c, pair, w_e, a_w)
        A = stability.error_matrix(g, w_e, a_w)
        scale = np.abs(A).max()
        np.testing.assert_allclose(J[2:, 2:] / scale, A / scale, atol=1e-8)
        assert not J[2:, :2].any()
        poles = np.concatenate([*stability.eigenvalues(A), [-g.L, -g.L]])
        # coefficients, since the roots of a double pole move by the root of the rounding
        np.testing.assert_allclose(np.poly(J), np.poly(poles).real, rtol=1e-6)


@pytest.mark.parametrize("w_e", [150.0, 600.0])
def test_poles_of_the_engine_side_in_closed_form(w_e):
    """(s + γ_l)(s + p)² + l_1 γ_e ω_e² s = 0, and the slow pole near -γ_l p²/(p² + l_1 γ_e ω_e²)."""
    _, _, g = observer("paper_car", 1, 2)
    poles, _ = stability.eigenvalues(stability.error_matrix(g, w_e, 5.0))
    p, k = g.l_1 / 2, g.l_1 * g.g_e * w_e**2
    residue = (poles + g.g_l) * (poles + p) ** 2 + k * poles
    np.testing.assert_allclose(residue / p**3, 0.0, atol=1e-9)
    assert poles[0].real == pytest.approx(-g.g_l * p**2 / (p**2 + k), rel=0.01)


# --- observability ---


def gramian(g, w_e, a_w, seconds=0.2, n=2001):
    """∫ Φᵀ CᵀC Φ dt without leakage, for speeds as functions of time, in units of one N·m."""
    unit = np.array([1 / 200, g.R_1 / 5, 1 / (g.J_e * 200), 1, 1 / (g.J_e1 * 200), 1])

    def system(t):
        A = np.zeros((6, 6))
        A[2, [0, 3]] = w_e(t) / g.J_e, -1 / g.J_e
        A[4, [1, 5]] = -a_w(t) / (g.J_e1 * g.R_1), 1 / g.J_e1
        return A * unit / unit[:, None]

    times = np.linspace(0, seconds, n)
    found = solve_ivp(
        lambda t, x: (system(t) @ x.reshape(6, 6)).ravel(),
        (0, seconds),
        np.eye(6).ravel(),
        t_eval=times,
        rtol=1e-9,
    )
    outputs = found.y.reshape(6, 6, n)[[2, 4]]
    return np.einsum("ijt,ikt->jk", outputs, outputs) / n, unit


@pytest.mark.parametrize(("car", "g1", "g2"), CASES)
def test_the_rank_is_that_of_the_gramian(car, g1, g2):
    """4 of 6 at every frozen point; the null space of the Gramian is the one that is told."""
    _, _, g = observer(car, g1, g2)
    for w_e, a_w in points(car, g1, g2):
        found = stability.observability(g, w_e, a_w)
        W, unit = gramian(g, lambda t, w=w_e: w, lambda t, a=a_w: a)
        values = np.linalg.eigvalsh(W)
        assert found.rank == np.sum(values > 1e-8 * values[-1]) == 4
        assert found.unobservable.shape == (6, 2)
        hidden = found.unobservable / unit[:, None]
        hidden /= np.linalg.norm(hidden, axis=0)
        np.testing.assert_allclose(np.diag(hidden.T @ W @ hidden) / values[-1], 0.0, atol=1e-10)
        # δτ_e ω_e = δT_c and δτ_o dω_w/dt / R_1 = δT_a1 are these directions
        for direction in ([1, 0, 0, w_e, 0, 0], [0, 1, 0, 0, 0, a_w / g.R_1]):
            scaled = np.array(direction) / unit
            inside = hidden @ np.linalg.lstsq(hidden, scaled, rcond=None)[0]
            np.testing.assert_allclose(inside, scaled, atol=1e-8 * np.linalg.norm(scaled))


def test_two_cars_that_no_data_can_tell_apart():
    """10 N·m of engine torque more on one, 10 N·m of clutch torque less on the other: the same speeds forever."""
    _, pair, g = observer("paper_car", 1, 2)
    w_e, a_w, T_e, T_c, tau_o, T_a1 = 200.0, 6.0, 120.0, 100.0, 150.0, 90.0
    other_T_c, other_tau_o = T_c + 10.0, tau_o + 10.0
    dw_e = [(T_e - T_c) / g.J_e, (T_e + 10.0 / w_e * w_e - other_T_c) / g.J_e]
    other_T_a1 = T_a1 + 10.0 * a_w / g.R_1
    dw_c1 = [(T_a1 - tau_o * a_w / g.R_1) / g.J_e1, (other_T_a1 - other_tau_o * a_w / g.R_1) / g.J_e1]
    assert dw_e[0] == pytest.approx(dw_e[1])
    assert dw_c1[0] == pytest.approx(dw_c1[1])
    told = stability.misreading(pair)
    R_1, R_2 = (CARS["paper_car"].vehicle.gear(k).total_ratio for k in (1, 2))
    assert told.sum_per_engine == 1.0
    assert told.clutch1_per_engine == pytest.approx(-R_2 / (R_1 - R_2))
    assert told.clutch2_per_engine == pytest.approx(R_1 / (R_1 - R_2))
    assert told.side_per_output == pytest.approx(1 / R_1)
    assert told.clutch1_per_output == pytest.approx(1 / (R_1 - R_2)) == -told.clutch2_per_output


def test_leakage_pretends_to_know_and_variation_really_does():
    """With leakage the rank is 6 (5 at cruise); without, ω_e and dω_w/dt have to vary at constant torques."""
    _, _, g = observer("paper_car", 1, 2)
    assert stability.observability(g, 200.0, 5.0, leakage=True).rank == 6
    assert stability.observability(g, 200.0, 0.0, leakage=True).rank == 5
    W, _ = gramian(g, lambda t: 200 * (1 + 0.5 * np.sin(30 * t)), lambda t: 5 * np.cos(40 * t))
    values = np.linalg.eigvalsh(W)
    assert np.sum(values > 1e-8 * values[-1]) == 6


# --- the Lyapunov function ---


@pytest.mark.parametrize(("car", "g1", "g2"), CASES)
def test_the_rate_of_v_is_76_and_the_same_everywhere(car, g1, g2):
    _, _, g = observer(car, g1, g2)
    P = stability.lyapunov_weights(g)
    expected = np.sort([-2 * g.l_1, -2 * g.l_3, -2 * g.g_l, -2 * g.g_l, 0.0, 0.0])
    rng = np.random.default_rng(1)
    for w_e, a_w in [*points(car, g1, g2), *rng.normal(0, [300, 15], (20, 2))]:
        rate = stability.lyapunov_rate(stability.error_matrix(g, w_e, a_w), P)
        np.testing.assert_allclose(np.linalg.eigvalsh(rate), expected, atol=1e-9 * g.l_1)
    assert stability.rate_spread(g) < 1e-14
    wrong = replace(g, g_t=2 * g.g_t)  # weights of another γ_t do not cancel
    rate = stability.lyapunov_rate(stability.error_matrix(wrong, 200.0, 8.0), P)
    assert np.abs(rate - np.diag(np.diag(rate))).max() > 1.0


def wander(rng, size, seconds, knots=40):
    """Return a function of time that jumps about within ±size as fast as ``knots`` allow."""
    values = rng.uniform(-size, size, knots)
    return lambda t: values[min(int(t / seconds * knots), knots - 1)]


@pytest.mark.parametrize(("car", "g1", "g2"), CASES)
def test_v_never_grows_and_errors_die_out_at_the_promised_rate(car, g1, g2):
    """Along errors while ω_e and dω_w/dt jump at random, with the losses switching between drive and coast."""
    settings = CARS[car]
    _, _, g = observer(car, g1, g2)
    efficiency = settings.vehicle.gear_efficiency * settings.vehicle.final_drive_efficiency
    P, rng, seconds = stability.lyapunov_weights(g), np.random.default_rng(4), 2.0
    grip = 9.81 / settings.vehicle.chassis.wheel_radius_m
    assert grip < stability.acceleration_limit(g, efficiency)
    rates = stability.engine_bound(g, 700.0).decay_rate, stability.shaft_bound(g, grip, efficiency).decay_rate
    assert 1.0 < min(rates) <= max(rates) <= g.g_l
    for _ in range(3):
        w_e, a_w = wander(rng, 700.0, seconds), wander(rng, grip, seconds)
        loss = wander(rng, 1.0, seconds)

        def rate(t, x, w_e=w_e, a_w=a_w, loss=loss):
            f = efficiency if loss(t) < 0 else 1 / efficiency
            return stability.error_matrix(g, w_e(t), a_w(t), f) @ x

        start = rng.normal(0, 1, 6) / np.sqrt(P)
        times = np.linspace(0, seconds, 400)
        found = solve_ivp(rate, (0, seconds), start, t_eval=times, rtol=1e-8, max_step=seconds / 80)
        z = np.sqrt(P)[:, None] * found.y
        V = 0.5 * (z**2).sum(axis=0)
        assert np.all(np.diff(V) <= 1e-9 * V[0])
        for rows, decay in (([0, 2, 3], rates[0]), ([1, 4, 5], rates[1])):
            size = np.linalg.norm(z[rows], axis=0)
            # W = ½|z|² + ε w T is within (1 ± ε) ½|z|²
            assert size[-1] <= 20.0 * size[0] * np.exp(-decay * seconds)


def test_losses_beyond_the_limit_let_v_grow():
    """The limit is sharp: just below it the rate is semidefinite, just above it is not."""
    _, _, g = observer("paper_car", 3, 4)
    P, limit = stability.lyapunov_weights(g), stability.acceleration_limit(g, 0.8)
    for share, positive in ((0.99, False), (1.01, True)):
        A = stability.error_matrix(g, 200.0, share * limit, 1 / 0.8)
        assert (np.linalg.eigvalsh(stability.lyapunov_rate(A, P))[-1] > 1e-3) == positive
    assert stability.acceleration_limit(g, 1.0) == np.inf


def test_a_gear_change_changes_v():
    _, _, first = observer("paper_car", 1, 2)
    _, _, second = observer("paper_car", 3, 2)
    ratio = stability.lyapunov_weights(second) / stability.lyapunov_weights(first)
    jump = stability.weight_jump(first, second)
    assert jump == pytest.approx(max(ratio.max(), 1 / ratio.min()))
    assert jump == pytest.approx(stability.weight_jump(second, first))
    assert jump > 1.5
    assert stability.weight_jump(first, first) == 1.0


def test_where_errors_come_to_rest():
    """T̃_c = ω_e τ_e, and (2/p)(1 + γ_e ω_e²/γ_l) dT_c/dt; T̃_a1 likewise with dω_w/dt / R_1."""
    _, _, g = observer("avante_dct7", 3, 4)
    w_e, a_w = 300.0, 4.0
    A = stability.error_matrix(g, w_e, a_w)
    p = g.l_1 / 2
    wrong = stability.stationary_errors(A, g, tau_e=0.05, tau_o_excess=20.0)
    np.testing.assert_allclose(wrong, [0.05, 20.0, 0.0, w_e * 0.05, 0.0, 20.0 * a_w / g.R_1], atol=1e-12)
    moving = stability.stationary_errors(A, g, dT_c=1000.0, dT_a1=500.0)
    assert moving[3] == pytest.approx(2000.0 / p * (1 + g.g_e * w_e**2 / g.g_l))
    assert moving[5] == pytest.approx(2 * 500.0 / (g.l_3 / 2) * (1 + g.g_t * (a_w / g.R_1) ** 2 / g.g_l))


def test_bounds_hold_while_speeds_jump():
    """Neither a wrong engine torque nor a ramp ever ends beyond the ultimate bound."""
    _, _, g = observer("paper_car", 1, 2)
    rng, seconds, w_max, tau_e, dT_c = np.random.default_rng(8), 6.0, 300.0, 0.04, 800.0
    bound = stability.engine_bound(g, w_max)
    assert bound.loop_gain < 1.0
    for b, limit in (
        (np.array([g.g_l * tau_e, 0, 0]), tau_e * bound.torque_per_adaptive),
        (np.array([0, 0, dT_c]), dT_c * bound.torque_per_rate),
    ):
        w_e = wander(rng, w_max, seconds, 200)

        def rate(t, x, b=b, w_e=w_e):
            return stability.error_matrix(g, w_e(t), 0.0)[np.ix_([0, 2, 3], [0, 2, 3])] @ x + b

        found = solve_ivp(
            rate, (0, seconds), np.zeros(3), t_eval=np.linspace(3, seconds, 2000), rtol=1e-7, max_step=5e-3
        )
        largest = np.abs(found.y[2]).max()
        assert 0.4 * limit < largest < limit
    frozen = stability.stationary_errors(stability.error_matrix(g, w_max, 0.0), g, tau_e=tau_e)[3]
    assert frozen < tau_e * bound.torque_per_adaptive < 2.5 * frozen
    fast = stability.engine_bound(g, 700.0)
    assert fast.loop_gain > 1.0
    assert np.isfinite(fast.torque_per_adaptive)


# --- driving conditions ---


def test_pairs_that_a_gearbox_preselects():
    assert neighbouring_pairs(CARS["paper_car"].vehicle) == ((1, 2), (3, 2), (3, 4), (5, 4))
    pairs = all_pairs(CARS["avante_dct7"].vehicle)
    assert len(pairs) == 16
    assert (3, -1) in pairs


@pytest.mark.parametrize(
    ("car", "pair"), [(car, pair) for car in CARS for pair in all_pairs(CARS[car].vehicle)], ids=str
)
def test_conditions_balance(car, pair):
    """Energy: what comes out of the clutch goes into losses, road and speed; the engine turns with its gear."""
    vehicle = CARS[car].vehicle
    chassis, efficiency = vehicle.chassis, vehicle.gear_efficiency * vehicle.final_drive_efficiency
    conditions = driving_conditions(vehicle, *pair)
    assert [q.name for q in conditions][-3:] == ["accelerating", "cruise", "braking"]
    assert (conditions[0].name == "launch") == (abs(conditions[0].gear) == 1)
    for q in conditions:
        R, v = vehicle.gear(q.gear).total_ratio, abs(q.wheel_speed_rad_s) * chassis.wheel_radius_m
        T_v = chassis.wheel_radius_m * (
            chassis.rolling_resistance * chassis.mass_kg * 9.80665
            + 0.6 * v**2 * chassis.drag_coefficient * chassis.frontal_area_m2
        )
        if q.name != "launch":
            assert q.engine_speed_rad_s == pytest.approx(R * q.wheel_speed_rad_s)
        forward = np.sign(q.wheel_speed_rad_s)
        power_in, power_out = q.clutch_torque_nm * R * forward, q.output_torque_nm * forward
        assert power_out == pytest.approx(power_in * (efficiency if power_in > 0 else 1 / efficiency))
        if q.name == "braking":
            assert q.wheel_acceleration_rad_s2 * forward == pytest.approx(-3.0 / chassis.wheel_radius_m)
        else:
            assert power_out == pytest.approx(T_v + chassis.inertia_kgm2 * q.wheel_acceleration_rad_s2 * forward)
            assert 0 < q.clutch_torque_nm <= 1.0001 * full_engine_torque(vehicle)
