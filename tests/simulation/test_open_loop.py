"""Both driveline models open loop, against scipy's stiff solver on the pure equations, and against the plant."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dctorque_can.driveline import compliant, conventional
from dctorque_can.driveline.gear_pair import GearPair
from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.simulation.open_loop import DrivelineModel, run_open_loop
from dctorque_can.simulation.plant import position_for
from dctorque_can.simulation.powertrain import DEMO_POWERTRAIN, parameters
from dctorque_can.simulation.tie_up import tie_up
from dctorque_can.simulation.truth import TRUTH

CARS = ["paper_vehicle", "avante_vehicle"]
CONVENTIONAL, COMPLIANT = DrivelineModel
T_E, T_C1, T_C2 = 130.0, 80.0, 40.0
W_W = 14.0  # rad/s
SECONDS = 0.25


def plain(vehicle: Vehicle) -> Vehicle:
    """Without gear losses and drag of open clutches, which the equations of section 2 do not have."""
    clutches = tuple(replace(clutch, drag_nms_per_rad=0.0) for clutch in vehicle.clutches)
    return replace(vehicle, gear_efficiency=1.0, final_drive_efficiency=1.0, clutches=(clutches[0], clutches[1]))


def both_slip(vehicle: Vehicle) -> np.ndarray:
    """Inputs of a car that rolls in gears 1 and 2 with both clutches slipping at constant capacity."""
    p = parameters(vehicle, DEMO_POWERTRAIN, 0.0)
    rows = np.zeros(round(SECONDS * 1000) + 1, TRUTH)
    rows["t_us"] = 1000 * np.arange(len(rows))
    rows["engine_torque_nm"] = rows["engine_torque_nominal_nm"] = T_E
    rows["gear1"], rows["gear2"] = 1, 2
    for i, torque in enumerate((T_C1, T_C2)):
        rows[f"clutch{i + 1}_position_mm"] = position_for(p, i, torque, True)
        rows[f"clutch{i + 1}_torque_nm"] = torque
        rows[f"phase{i + 1}"] = ClutchPhase.SLIPPING
    pair = GearPair.of(vehicle, 1, 2, all_gears_turn=True)
    rows["output_torque_nm"] = pair.R_1 * T_C1 + pair.R_2 * T_C2
    speeds = {"engine": pair.R_1 * W_W + 150.0, "damper": pair.R_1 * W_W + 150.0, "output": W_W, "wheel": W_W}
    for name, speed in (speeds | {"shaft1": pair.R_1 * W_W, "shaft2": pair.R_2 * W_W}).items():
        rows[f"{name}_speed_rad_s"] = speed
    return rows


def oracle(vehicle: Vehicle, model: DrivelineModel, first: np.void, start: np.void) -> np.ndarray:
    """Return speeds [engine, damper, shaft 1, shaft 2, output, wheel] at the end, by Radau on the pure functions.

    Args:
        vehicle: the car.
        model: which equations.
        first: first row of the inputs.
        start: first row of the model's answer: its torques give the initial twists.
    """
    pair = GearPair.of(vehicle, 1, 2, all_gears_turn=True)
    v, o = vehicle, vehicle.output_shaft
    J_v, d = v.chassis.inertia_kgm2, v.damper
    w = [float(first[f"{n}_speed_rad_s"]) for n in ("engine", "damper", "shaft1", "shaft2", "output", "wheel")]
    twists = [T_E / d.stiffness_nm_per_rad, 0.0, 0.0, float(start["output_torque_nm"]) / o.stiffness_nm_per_rad]
    for i, shaft in enumerate(v.shafts, start=1):
        twists[i] = float(start[f"transfer{i}_torque_nm"]) / shaft.transfer_stiffness_nm_per_rad

    def compliant_rates(_: float, y: Any) -> list[Any]:
        w_e, w_d, w_1, w_2, w_o, w_w, th_d, th_1, th_2, th_o = y
        T_d = conventional.damper_torque(th_d, w_e, w_d, d.stiffness_nm_per_rad, d.damping_nms_per_rad)
        T_t = [
            compliant.transfer_shaft_torque(
                th, w_c, w_o, i_t, i_f, s.transfer_stiffness_nm_per_rad, s.transfer_damping_nms_per_rad
            )
            for th, w_c, i_t, i_f, s in (
                (th_1, w_1, pair.i_t1, pair.i_f1, v.shafts[0]),
                (th_2, w_2, pair.i_t2, pair.i_f2, v.shafts[1]),
            )
        ]
        T_o = compliant.output_torque(th_o, w_o, w_w, o.stiffness_nm_per_rad, o.damping_nms_per_rad)
        return [
            conventional.engine_acceleration(T_E, T_d, v.engine_inertia_kgm2),
            conventional.damper_acceleration(T_d, T_C1, T_C2, d.inertia_kgm2),
            compliant.input_shaft_acceleration(T_C1, T_t[0], pair.i_t1, pair.J_1),
            compliant.input_shaft_acceleration(T_C2, T_t[1], pair.i_t2, pair.J_2),
            compliant.output_shaft_acceleration(T_t[0], T_t[1], T_o, pair, o.inertia_kgm2),
            compliant.wheel_acceleration(T_o, conventional.road_load(v.chassis, 0.0, w_w), J_v),
            w_e - w_d,
            w_1 / pair.i_t1 - pair.i_f1 * w_o,
            w_2 / pair.i_t2 - pair.i_f2 * w_o,
            w_o - w_w,
        ]

    def conventional_rates(_: float, y: Any) -> list[Any]:
        w_e, w_d, w_1, w_w, th_d, th_o = y
        T_d = conventional.damper_torque(th_d, w_e, w_d, d.stiffness_nm_per_rad, d.damping_nms_per_rad)
        k, b = (
            conventional.before_final_drive(x, pair.i_f1) for x in (o.stiffness_nm_per_rad, o.damping_nms_per_rad)
        )
        T_o = conventional.output_torque(th_o, w_1, w_w, pair.i_t1, pair.i_f1, k, b)
        return [
            conventional.engine_acceleration(T_E, T_d, v.engine_inertia_kgm2),
            conventional.damper_acceleration(T_d, T_C1, T_C2, d.inertia_kgm2),
            conventional.input_shaft1_acceleration(T_C1, T_C2, T_o, pair),
            conventional.wheel_acceleration(T_o, conventional.road_load(v.chassis, 0.0, w_w), pair.i_f1, J_v),
            w_e - w_d,
            w_1 / pair.i_t1 - pair.i_f1 * w_w,
        ]

    options: dict[str, Any] = {"method": "Radau", "rtol": 1e-9, "atol": 1e-10}
    if model is COMPLIANT:
        return np.asarray(solve_ivp(compliant_rates, (0.0, SECONDS), [*w, *twists], **options).y[:6, -1])
    begin = [w[0], w[1], w[2], w[5], twists[0], twists[3] * pair.i_f1]
    w_e, w_d, w_1, w_w = solve_ivp(conventional_rates, (0.0, SECONDS), begin, **options).y[:4, -1]
    return np.array([w_e, w_d, w_1, w_1 * pair.R_2 / pair.R_1, w_1 / pair.R_1, w_w])


@pytest.mark.parametrize("model", [CONVENTIONAL, COMPLIANT])
@pytest.mark.parametrize("car", CARS)
def test_the_integrator_agrees_with_a_stiff_solver_on_the_equations(
    car: str, model: DrivelineModel, request: pytest.FixtureRequest
) -> None:
    """A smooth quarter of a second, both clutches slipping: the same speeds as Radau on (1)-(17)."""
    vehicle = plain(request.getfixturevalue(car))
    inputs = both_slip(vehicle)
    rows = run_open_loop(vehicle, model, inputs)
    assert set(rows["phase1"][1:]) == set(rows["phase2"][1:]) == {ClutchPhase.SLIPPING}
    expected = oracle(vehicle, model, inputs[0], rows[0])
    names = ("engine", "damper", "shaft1", "shaft2", "output", "wheel")
    found = np.array([rows[f"{name}_speed_rad_s"][-1] for name in names])
    np.testing.assert_allclose(found, expected, rtol=2e-5)
    assert abs(found[0] - inputs["engine_speed_rad_s"][0]) > 5.0  # something has happened


@pytest.mark.parametrize("car", CARS)
def test_torque_recirculates_in_both_models(car: str, request: pytest.FixtureRequest) -> None:
    """Clutch 1 locked, clutch 2 pressed beyond the engine's torque: clutch 1 and its transfer shaft turn negative.

    The paper has it for the compliant model. A rigid mesh hands the torque on just as well: what a locked clutch
    carries is whatever keeps its slip at zero.
    """
    vehicle = request.getfixturevalue(car)
    truth = tie_up(vehicle, 6.0, 60.0, 120.0)
    held = slice(500, 900)
    means = []
    for torque in (truth, *(run_open_loop(vehicle, model, truth) for model in DrivelineModel)):
        assert set(torque["phase1"]) == {ClutchPhase.LOCKED}
        assert np.all(torque["phase2"][held] == ClutchPhase.SLIPPING)
        assert torque["clutch1_torque_nm"][:200].mean() > 30.0
        assert torque["clutch2_torque_nm"][held].mean() == pytest.approx(120.0, abs=1.0)
        means.append(torque["clutch1_torque_nm"][held].mean())
        if torque is not truth:
            assert torque["transfer1_torque_nm"][held].mean() < -200.0
            assert torque["transfer2_torque_nm"][held].mean() > 200.0
    assert max(means) < -50.0
    assert means[1:] == pytest.approx([means[0]] * 2, abs=10.0)
    assert means[1] == pytest.approx(means[2], abs=1.0)  # compliance or not


def test_without_pressure_nothing_recirculates(paper_vehicle: Vehicle) -> None:
    truth = tie_up(paper_vehicle, 6.0, 60.0, 0.0)
    for torque in (truth, *(run_open_loop(paper_vehicle, model, truth) for model in DrivelineModel)):
        assert torque["clutch1_torque_nm"].min() > 20.0


def test_a_stiff_transfer_shaft_is_a_rigid_one(paper_vehicle: Vehicle) -> None:
    """The compliant model comes closer to the conventional one as its transfer shafts stiffen."""
    vehicle = paper_vehicle
    truth = tie_up(vehicle, 6.0, 60.0, 120.0)
    rigid = run_open_loop(vehicle, CONVENTIONAL, truth)["clutch1_torque_nm"]
    distances = []
    for factor in (1.0, 10.0, 100.0):
        shafts = tuple(
            replace(
                shaft,
                transfer_stiffness_nm_per_rad=factor * shaft.transfer_stiffness_nm_per_rad,
                transfer_damping_nms_per_rad=factor**0.5 * shaft.transfer_damping_nms_per_rad,
            )
            for shaft in vehicle.shafts
        )
        stiff = run_open_loop(replace(vehicle, shafts=(shafts[0], shafts[1])), COMPLIANT, truth)
        distances.append(float(np.sqrt(np.mean((stiff["clutch1_torque_nm"] - rigid)[1:] ** 2))))
    assert distances[1] < 0.25 * distances[0]
    assert distances[2] < 0.25 * distances[1]


def test_the_whole_drive_on_commands_alone(paper_vehicle: Vehicle, paper_truth: np.ndarray) -> None:
    """Sixteen seconds without feedback: launch, both shifts, gear changes and the stop happen in both models."""
    for model in DrivelineModel:
        rows = run_open_loop(paper_vehicle, model, paper_truth)
        error = rows["wheel_speed_rad_s"] - paper_truth["wheel_speed_rad_s"]
        assert np.sqrt(np.mean(error**2)) < 0.3
        assert rows["wheel_speed_rad_s"][-1] == pytest.approx(0.0, abs=1e-6)
        for i in "12":
            difference = rows[f"clutch{i}_torque_nm"] - paper_truth[f"clutch{i}_torque_nm"]
            assert np.sqrt(np.mean(difference**2)) < 12.0
