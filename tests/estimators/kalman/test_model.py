"""The Kalman estimator's linear model against the driveline's own functions, scipy and numerical integration."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm

from dctorque_can.config.load import load_config
from dctorque_can.driveline import compliant, conventional
from dctorque_can.driveline.gear_pair import GearPair
from dctorque_can.errors import DctorqueError
from dctorque_can.estimators.kalman import model
from dctorque_can.estimators.kalman.model import STEPS_US, N, State
from dctorque_can.resources import shipped_config

CARS = {name: load_config(shipped_config(name)).settings for name in ("paper_car", "avante_dct7")}
GEARS = {"paper_car": (3, 2), "avante_dct7": (3, 4)}


def right_hand_side(vehicle, design, g1, g2, x, T_en):
    """dx/dt of a car without losses, from the functions of the two models alone."""
    x = dict(zip(State, x, strict=True))
    S = State
    pair = GearPair.of(vehicle, g1, g2, all_gears_turn=True)
    damper, output, chassis = vehicle.damper, vehicle.output_shaft, vehicle.chassis
    T_d = conventional.damper_torque(
        x[S.TH_D], x[S.W_E], x[S.W_D], damper.stiffness_nm_per_rad, damper.damping_nms_per_rad
    )
    T_t = [
        compliant.transfer_shaft_torque(
            x[twist],
            x[speed],
            x[S.W_O],
            i_t,
            i_f,
            shaft.transfer_stiffness_nm_per_rad,
            shaft.transfer_damping_nms_per_rad,
        )
        for twist, speed, i_t, i_f, shaft in (
            (S.TH_T1, S.W_C1, pair.i_t1, pair.i_f1, vehicle.shafts[0]),
            (S.TH_T2, S.W_C2, pair.i_t2, pair.i_f2, vehicle.shafts[1]),
        )
    ]
    T_o = compliant.output_torque(
        x[S.TH_O], x[S.W_O], x[S.W_W], output.stiffness_nm_per_rad, output.damping_nms_per_rad
    )
    J_w = chassis.wheel_inertia_kgm2 / 2
    rate = {
        S.W_E: conventional.engine_acceleration(T_en + x[S.DT_E], T_d, vehicle.engine_inertia_kgm2),
        S.W_D: conventional.damper_acceleration(T_d, x[S.T_C1], x[S.T_C2], damper.inertia_kgm2),
        S.W_C1: compliant.input_shaft_acceleration(x[S.T_C1], T_t[0], pair.i_t1, pair.J_1),
        S.W_C2: compliant.input_shaft_acceleration(x[S.T_C2], T_t[1], pair.i_t2, pair.J_2),
        S.W_O: compliant.output_shaft_acceleration(*T_t, T_o, pair, output.inertia_kgm2),
        S.W_W: compliant.wheel_acceleration(T_o, x[S.T_X], J_w),
        S.W_B: compliant.wheel_acceleration(x[S.T_X], x[S.T_V], chassis.inertia_kgm2 - J_w),
        S.TH_D: x[S.W_E] - x[S.W_D],
        S.TH_T1: x[S.W_C1] / pair.i_t1 - pair.i_f1 * x[S.W_O],
        S.TH_T2: x[S.W_C2] / pair.i_t2 - pair.i_f2 * x[S.W_O],
        S.TH_O: x[S.W_O] - x[S.W_W],
        S.T_C1: x[S.R_1],
        S.T_C2: x[S.R_2],
        S.R_1: -x[S.R_1] / design.torque_rate_time_s,
        S.R_2: -x[S.R_2] / design.torque_rate_time_s,
        S.T_V: 0.0,
        S.DT_E: -x[S.DT_E] / design.engine_torque_error_time_s,
        S.GAIN: -x[S.GAIN] / 20.0,
        S.LAG_1: -x[S.LAG_1] / 300.0,
        S.LAG_2: -x[S.LAG_2] / 300.0,
        S.SCALE: -x[S.SCALE] * 0.5 * (3e-5 / design.wheel_scale_error_share) ** 2,
        S.RATIO_1: 0.0,
        S.RATIO_2: 0.0,
        S.LATE: -x[S.LATE] / 1e4,
    }
    damping = design.tyre_slip_stiffness * chassis.mass_kg / 2 * 9.80665 * chassis.wheel_radius_m**2 / 30.0
    rate[S.T_X] = pair.R_1 * x[S.R_1] + pair.R_2 * x[S.R_2] + damping * (rate[S.W_W] - rate[S.W_B])
    return np.array([rate[state] for state in State]), T_o


@pytest.mark.parametrize("car", list(CARS))
def test_a_is_the_derivative_of_the_driveline(car):
    """Central differences of the two models' functions give every entry of A and the row of T_o."""
    design = CARS[car].kalman
    vehicle = replace(CARS[car].vehicle, gear_efficiency=1.0, final_drive_efficiency=1.0)
    point = np.random.default_rng(5).normal(0.0, 100.0, N)
    A, T_o = model.continuous(vehicle, design, *GEARS[car], (True, False))
    for j in range(N):
        step = np.zeros(N)
        step[j] = 1.0
        above, below = (
            right_hand_side(vehicle, design, *GEARS[car], point + sign * step, 70.0) for sign in (1, -1)
        )
        scale = max(1.0, np.abs(A[:, j]).max())
        np.testing.assert_allclose((above[0] - below[0]) / 2, A[:, j], atol=1e-6 * scale)
        assert (above[1] - below[1]) / 2 == pytest.approx(T_o[j], abs=1e-4)


@pytest.mark.parametrize(("drives", "sign"), [(True, 1.0), (False, -1.0)])
def test_losses_are_against_the_flow_of_power(drives, sign):
    """T_o = R η^±1 T_c at constant speeds: less behind the gears when they drive, more when they are driven."""
    vehicle, design = CARS["paper_car"].vehicle, CARS["paper_car"].kalman
    A, _ = model.continuous(vehicle, design, 1, 2, (drives, drives))
    for i, gear in enumerate((vehicle.gear(1), vehicle.gear(2))):
        on_output = A[State.W_O, State.TH_T1 + i] * vehicle.output_shaft.inertia_kgm2
        on_shaft = -A[State.W_C1 + i, State.TH_T1 + i] * vehicle.shaft_inertia_kgm2(i + 1)
        efficiency = vehicle.gear_efficiency * vehicle.final_drive_efficiency
        assert on_output / on_shaft == pytest.approx(gear.total_ratio * efficiency**sign)


def test_a_synchroniser_stands_between_shaft_and_output():
    """In neutral the torque of shaft 1 acts on it once, on the output shaft −R times, on the damper not at all."""
    vehicle, design = CARS["paper_car"].vehicle, CARS["paper_car"].kalman
    A, _ = model.continuous(vehicle, design, 0, 2, (True, True))
    ratio = np.mean([vehicle.gear(number).total_ratio for number in (1, 3)])  # both neighbours of second gear
    assert A[State.W_C1, State.T_C1] * vehicle.shaft_inertia_kgm2(1) == pytest.approx(1.0)
    assert A[State.W_O, State.T_C1] * vehicle.output_shaft.inertia_kgm2 == pytest.approx(-ratio)
    assert A[State.W_D, State.T_C1] == 0.0
    assert A[State.W_D, State.T_C2] * vehicle.damper.inertia_kgm2 == pytest.approx(-1.0)
    assert A[State.W_C1, State.TH_T1] == A[State.W_O, State.TH_T1] == 0.0


def test_discretisation_of_a_soft_system():
    """Doubling gives scipy's matrix exponential, and the integrals of F q Fᵀ and F B by adaptive quadrature."""
    A = np.array([[0.0, 1.0, 0.0], [-400.0, -8.0, 30.0], [0.0, 0.0, -5.0]])
    B = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 7.0]])
    q = np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 1.0], [0.0, 1.0, 2.0]])
    result = model.discrete(A, B, q[None])
    assert len(result) == len(STEPS_US)
    for step_us, (F, b, (Q,)) in zip(STEPS_US, result, strict=True):
        h = step_us * 1e-6
        np.testing.assert_allclose(F, expm(A * h), atol=1e-10)
        np.testing.assert_allclose(b, quad_vec(lambda s: expm(A * s) @ B, 0.0, h)[0], rtol=1e-7, atol=1e-13)
        expected = quad_vec(lambda s: expm(A * s) @ q @ expm(A * s).T, 0.0, h)[0]
        np.testing.assert_allclose(Q, expected, rtol=1e-6, atol=1e-7 * np.abs(expected).max())


HALVES = [
    (step, STEPS_US.index(us // 2)) for step, us in enumerate(STEPS_US) if us % 2 == 0 and us // 2 in STEPS_US
]


@pytest.mark.parametrize("car", list(CARS))
def test_two_steps_are_one_of_twice_the_length(car):
    """F(2h) = F(h)², Q(2h) = F(h) Q(h) F(h)ᵀ + Q(h) and b(2h) = F(h) b(h) + b(h) for each pair and direction."""
    t = model.tables(CARS[car].vehicle, CARS[car].kalman, 20)
    for of_model in t.steps:
        for step, half in HALVES:
            F = of_model[half]["phi"]
            np.testing.assert_allclose(of_model[step]["phi"], F @ F, atol=1e-9 * np.abs(F).max() ** 2)
            b = of_model[half]["input"]
            np.testing.assert_allclose(of_model[step]["input"], F @ b + b, rtol=1e-9, atol=1e-12)
            for factors in (np.zeros(5), *1e6 * np.eye(5)):
                Q = model.process_covariance(of_model[half], factors)
                whole = model.process_covariance(of_model[step], factors)
                np.testing.assert_allclose(whole, F @ Q @ F.T + Q, rtol=1e-7, atol=1e-9 * np.abs(whole).max())


@pytest.mark.parametrize("car", list(CARS))
def test_the_tables_leave_nothing_out_of_the_process_noise(car):
    """What they keep of Q, by what can be other than zero, is all of it: as `discrete` gives it for one model."""
    vehicle, design = CARS[car].vehicle, CARS[car].kalman
    t = model.tables(vehicle, design, 20)
    gears = [vehicle.gears_on(i)[0].number for i in (1, 2)]
    A, _ = model.continuous(vehicle, design, *gears, (True, True))
    places = (State.R_1, State.R_2, State.T_X, State.T_V, State.DT_E)
    per_s = (2.0 / design.torque_rate_time_s,) * 2 + (1.0, 1.0, 2.0 / design.engine_torque_error_time_s)
    intensity = np.zeros((6, N, N))
    intensity[0] = model.intensities(design)
    for n, (place, value) in enumerate(zip(places, per_s, strict=True)):
        intensity[1 + n, place, place] = value
    factors = np.array([9e6, 4e4, 400.0, 3600.0, 25.0])
    found = t.steps[t.row[gears[0] + 1, gears[1] + 1] + 3]
    for of_step, (_, _, noises) in zip(found, model.discrete(A, np.zeros((N, 1)), intensity), strict=True):
        Q = noises[0] + np.tensordot(factors, noises[1:], 1)
        np.testing.assert_allclose(model.process_covariance(of_step, factors), Q, rtol=1e-12)


def test_tables_hold_every_pair_and_nothing_else():
    vehicle, design = CARS["paper_car"].vehicle, CARS["paper_car"].kalman
    t = model.tables(vehicle, design, 10)
    pairs = {(g1, g2) for g1 in (0, 1, 3, 5) for g2 in (0, 2, 4)}
    found = {(g1 - 1, g2 - 1) for g1 in range(10) for g2 in range(10) if t.row[g1, g2] >= 0}
    assert found == pairs
    assert sorted(t.row[t.row >= 0]) == list(range(0, 4 * len(pairs), 4))


def test_a_driveline_too_fast_for_numbers_is_refused_with_its_gears():
    """Found by tools/fuzz: its steps overflowed, and the filter would have started anew at every frame."""
    settings = CARS["paper_car"]
    gears = [replace(gear, final_drive=32767.0) if gear.number == 3 else gear for gear in settings.vehicle.gears]
    with pytest.raises(DctorqueError, match=r"gears 3 and 0 .* too fast to be computed"):
        model.tables(replace(settings.vehicle, gears=tuple(gears)), settings.kalman, 12)
