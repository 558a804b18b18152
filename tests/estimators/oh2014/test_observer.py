"""The observer against the paper: the printed matrices, the Lyapunov function, and the sampled form's limits."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.config.load import load_config
from dctorque_can.estimators.oh2014 import model as oh2014_model
from dctorque_can.estimators.oh2014 import observer as oh2014
from dctorque_can.resources import shipped_config

SETTINGS = load_config(shipped_config("paper_car")).settings
VEHICLE = SETTINGS.vehicle
DESIGN = replace(SETTINGS.observer, printed_rate_law=True, phase_gating=False)


def observer(design=DESIGN, g1=1, g2=2, vehicle=VEHICLE):
    constants = oh2014_model.constants(vehicle, design)
    pair = np.zeros(1, oh2014_model.PAIR)
    oh2014_model.set_pair(pair[0], constants[0], g1, g2)
    return constants, pair


def gains(design, J_e, J_e1):
    """Pole placement by hand: (s + p)² = s² + 2 p s + p²."""
    p_e, p_s = design.engine_bandwidth_rad_s, design.shaft_bandwidth_rad_s
    return 2 * p_e, p_e**2 * J_e, 2 * p_s, p_s**2 * J_e1


def printed_system(design, g1, g2, w_e, w_c1, w_c2, a_w, T_en):
    """A and B of (68), typed from the paper's section 3."""
    one, two = VEHICLE.gear(g1), VEHICLE.gear(g2)
    i_t1, i_t2, i_f1, i_f2 = one.ratio, two.ratio, one.final_drive, two.final_drive
    R_1, R_2 = i_t1 * i_f1, i_t2 * i_f2
    J_e = VEHICLE.engine_inertia_kgm2 + VEHICLE.damper.inertia_kgm2
    shafts = VEHICLE.shafts
    J_e1 = (shafts[0].inertia_kgm2 + one.inertia_kgm2) + (shafts[1].inertia_kgm2 + two.inertia_kgm2) * (
        R_2 / R_1
    ) ** 2
    k_t1, k_t2 = shafts[0].transfer_stiffness_nm_per_rad, shafts[1].transfer_stiffness_nm_per_rad
    l_1, l_2, l_3, l_4 = gains(design, J_e, J_e1)
    L_1 = L_2 = design.torque_crossover_rad_s
    g_l = 1 / design.leakage_time_s
    g_e = 1 / (design.adaptation_time_s * 200.0**2)
    g_t = R_1**2 / (design.adaptation_time_s * 5.0**2)
    D = k_t1 * i_f1**2 + k_t2 * i_f2**2
    delta = R_1 - R_2
    tau_on = VEHICLE.chassis.mass_kg * VEHICLE.chassis.wheel_radius_m**2 + VEHICLE.chassis.wheel_inertia_kgm2
    A = np.zeros((8, 8))
    A[0, 0] = -L_1
    A[0, 4] = J_e * l_1 * g_t * k_t1 * a_w**2 / (i_t1**2 * D)
    A[0, 5] = -L_1 * R_2 / delta
    A[0, 6] = J_e1 * l_3 * g_t * k_t1 * a_w**2 / (i_t1**2 * D)
    A[0, 7] = L_1 * R_1 / delta
    A[1, 1] = -L_2
    A[1, 4] = J_e * l_1 * g_t * k_t2 * i_f2 * a_w**2 / (i_t1 * i_f1 * i_t2 * D)
    A[1, 5] = L_2 * R_1 / delta
    A[1, 6] = J_e1 * l_3 * g_t * k_t2 * i_f2 * a_w**2 / (i_t1 * i_f1 * i_t2 * D)
    A[1, 7] = -L_2 * R_1 / delta
    A[2, 2] = -g_l
    A[2, 4] = -J_e * l_1 * g_e * w_e
    A[3, 3] = -g_l
    A[3, 6] = J_e1 * l_3 * g_t * a_w / R_1
    A[4, 2] = w_e / J_e
    A[4, 4] = -l_1
    A[4, 5] = -1 / J_e
    A[5, 4] = l_2
    A[6, 3] = -a_w / (J_e1 * R_1)
    A[6, 6] = -l_3
    A[6, 7] = 1 / J_e1
    A[7, 6] = -l_4
    cross = k_t1 * k_t2 * i_f1 * i_f2 / (i_t1 * i_t2 * D)
    B = np.array(
        [
            k_t1 / i_t1**2 * (1 - k_t1 * i_f1**2 / D) * w_c1 - cross * w_c2 - (A[0, 6] * w_c1 + A[0, 4] * w_e),
            k_t2 / i_t2**2 * (1 - k_t2 * i_f2**2 / D) * w_c2 - cross * w_c1 - (A[1, 6] * w_c1 + A[1, 4] * w_e),
            J_e * l_1 * g_e * w_e**2,
            g_l * tau_on - A[3, 6] * w_c1,
            T_en / J_e + l_1 * w_e,
            -l_2 * w_e,
            l_3 * w_c1,
            l_4 * w_c1,
        ]
    )
    return A, B


@pytest.mark.parametrize(("g1", "g2"), [(1, 2), (3, 2), (3, 4), (5, 4)])
def test_right_hand_side_is_the_printed_system(g1, g2):
    rng = np.random.default_rng(7)
    constants, pair = observer(g1=g1, g2=g2)
    for _ in range(50):
        w_e, w_c1, w_c2 = rng.uniform(80, 600, 3)
        a_w, T_en = rng.normal(0, 8), rng.normal(0, 150)
        x = rng.normal(0, 1, 8) * [150, 150, 0.2, 200, 400, 150, 400, 150]
        A, B = printed_system(DESIGN, g1, g2, w_e, w_c1, w_c2, a_w, T_en)
        ours = oh2014.right_hand_side(x, constants[0], pair[0], w_e, w_c1, w_c2, a_w, T_en)
        scale = np.abs(A) @ np.abs(x) + np.abs(B) + 1e-9
        np.testing.assert_allclose(ours / scale, (A @ x + B) / scale, atol=1e-11)


def test_only_the_rows_of_the_clutch_torques_know_the_printed_rate_law():
    """Row 4 of A uses ε_o alone whatever the option says; rows 1 and 2 lose their column 5."""
    x = np.array([10.0, 20.0, 0.1, 150.0, 210.0, 90.0, 180.0, 80.0])
    point = (200.0, 190.0, 320.0, 5.0, 100.0)
    printed = oh2014.right_hand_side(x, *(a[0] for a in observer()), *point)
    plain = oh2014.right_hand_side(x, *(a[0] for a in observer(replace(DESIGN, printed_rate_law=False))), *point)
    A, _ = printed_system(DESIGN, 1, 2, *point)
    np.testing.assert_allclose(printed[2:], plain[2:])
    np.testing.assert_allclose((printed - plain)[:2], A[:2, 4] * (x[4] - point[0]), rtol=1e-9)


def test_lyapunov_derivative_is_equation_76():
    """Along errors of a plant with constant T_c, T_a1 and the adaptation's own targets, V̇ is (76) to rounding."""
    rng = np.random.default_rng(3)
    constants, pair = observer()
    c, p = constants[0], pair[0]
    J_e, J_e1, R_1 = float(c["J_e"]), float(p["J_es"]), float(p["R_1"])
    l_1, l_2, l_3, l_4 = gains(DESIGN, J_e, J_e1)
    g_l, g_e, g_t = float(c["g_l"]), float(p["g_e"]), float(p["g_t"])
    for _ in range(50):
        w_e, w_c1, w_c2 = rng.uniform(80, 600, 3)
        a_w, T_en, T_c, T_a1 = rng.normal(0, [8, 100, 100, 100])
        truth = np.array([0, 0, 0, float(c["J_v"]), w_e, T_c, w_c1, T_a1])
        rates = np.zeros(8)
        rates[4] = (T_en - T_c) / J_e
        rates[6] = (T_a1 - float(c["J_v"]) * a_w / R_1) / J_e1
        error = rng.normal(0, 1, 8) * [0, 0, 0.1, 50, 5, 50, 5, 50]
        estimate = truth - error
        d_error = rates - oh2014.right_hand_side(estimate, c, p, w_e, w_c1, w_c2, a_w, T_en)
        weight = np.array(
            [0, 0, 1 / (J_e**2 * l_1 * g_e), 1 / (J_e1**2 * l_3 * g_t), 1, 1 / (J_e * l_2), 1, 1 / (J_e1 * l_4)]
        )
        terms = weight * error * d_error
        claimed = (
            -g_l * error[2] ** 2 * weight[2]
            - g_l * error[3] ** 2 * weight[3]
            - l_1 * error[4] ** 2
            - l_3 * error[6] ** 2
        )
        assert terms.sum() == pytest.approx(claimed, abs=1e-10 * np.abs(terms).sum())
        assert claimed <= 0


def test_sampled_gains_become_the_continuous_ones():
    """α/h → l_1 and J β/h² → l_2 as the sampling time goes to zero."""
    p, J, h = 90.0, 0.23, 1e-6
    l_speed, l_torque = oh2014.continuous_gains(p, J)
    alpha, beta = oh2014.sampled_gains(p, h)
    assert alpha / h == pytest.approx(l_speed, rel=1e-3)
    assert J * beta / h**2 == pytest.approx(l_torque, rel=1e-3)


@pytest.mark.parametrize("h", [0.001, 0.01, 0.02])
def test_sampled_engine_observer_has_the_designed_poles(h):
    """The error of (ω_e, T_c) over one predict and correct has both eigenvalues exp(-p h), for any h."""
    constants, pair = observer()
    p = DESIGN.engine_bandwidth_rad_s
    columns = []
    for start in ((1.0, 0.0), (0.0, 1.0)):
        state = np.zeros(1, oh2014.STATE)
        state["w_e"], state["T_c"] = start
        oh2014.predict(state[0], constants[0], pair[0], 0.0, h)
        state["tau_e"] = 0.0
        oh2014.correct_engine(state[0], constants[0], pair[0], True, True, 0.0, h)
        columns.append([state["w_e"][0], state["T_c"][0]])
    matrix = np.array(columns).T
    z = np.exp(-p * h)
    assert np.trace(matrix) == pytest.approx(2 * z, abs=1e-9)
    assert np.linalg.det(matrix) == pytest.approx(z * z, abs=1e-9)


def test_only_shafts_that_carry_twist():
    """With clutch 2 open, shaft 2 says nothing, and all of T_o is on shaft 1: dT_c1 = dT_o/R_1."""
    constants, pair = observer(g1=1, g2=2)
    rates = oh2014.shaft_torque_rates(constants[0], pair[0], True, False, 150.0, 900.0, 500.0)
    assert rates == pytest.approx((500.0 / VEHICLE.gear(1).total_ratio, 0.0))
    rates = oh2014.shaft_torque_rates(constants[0], pair[0], False, True, 150.0, 900.0, 500.0)
    assert rates == pytest.approx((0.0, 500.0 / VEHICLE.gear(2).total_ratio))
    both = oh2014.shaft_torque_rates(constants[0], pair[0], True, True, 150.0, 900.0, 500.0)
    assert VEHICLE.gear(1).total_ratio * both[0] + VEHICLE.gear(2).total_ratio * both[1] == pytest.approx(500.0)
    assert observer(g1=0, g2=2)[1]["side"][0] == 2


def test_mirrored_solution_agrees_with_65_and_66():
    """T_a2 = T_c2 + (R_1/R_2) T_c1 and T_c = T_c1 + T_c2 give back the torques that made them."""
    _, pair = observer(g1=1, g2=2)
    T_1, T_2, ratio = 40.0, 95.0, float(pair["R_1"][0] / pair["R_2"][0])
    assert oh2014.unknown_input_torques(pair[0], T_1 + T_2, T_1 + T_2 / ratio, True, True) == pytest.approx(
        (T_1, T_2)
    )
    pair["side"] = 2
    assert oh2014.unknown_input_torques(pair[0], T_1 + T_2, T_2 + T_1 * ratio, True, True) == pytest.approx(
        (T_1, T_2)
    )


def test_road_load_on_the_flat_is_equation_11():
    constants, _ = observer()
    chassis = VEHICLE.chassis
    v = 20.0
    expected = chassis.wheel_radius_m * (
        chassis.rolling_resistance * chassis.mass_kg * 9.80665
        + 0.5 * 1.2 * v**2 * chassis.drag_coefficient * chassis.frontal_area_m2
    )
    assert oh2014.flat_road_load(constants[0], v / chassis.wheel_radius_m) == pytest.approx(expected)
    assert oh2014.flat_road_load(constants[0], 0.0) == 0.0
