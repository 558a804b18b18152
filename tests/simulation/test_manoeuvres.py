"""Each manoeuvre does what its name says, and obeys mechanics forwards and backwards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import STANDARD_GRAVITY, Vehicle
from dctorque_can.errors import DctorqueError
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.manoeuvres import MANOEUVRES
from dctorque_can.simulation.truth import energy_residual_j

from .driven import LOCKED, OPEN, SLIPPING, Rows, driven, part, seconds, speed


@pytest.mark.parametrize("name", list(MANOEUVRES))
def test_energy_and_momentum(avante_vehicle: Vehicle, name: str) -> None:
    """The ledger closes, no part gives heat back, and the reported torques move engine and car."""
    car, truth = avante_vehicle, driven(avante_vehicle, name)
    assert np.abs(energy_residual_j(truth)).max() < 1e-5 * truth["engine_work_j"].max()
    for heat in ("clutch1_heat_j", "clutch2_heat_j", "tyre_heat_j", "road_heat_j", "synchroniser_heat_j"):
        assert np.diff(truth[heat]).min() >= -1e-9, heat
    assert np.diff(truth["driveline_heat_j"]).min() > -0.01  # J in a millisecond
    for column in truth.dtype.names or ():
        assert np.all(np.isfinite(truth[column])), column
    assert truth["engine_speed_rad_s"].min() > (-1e-6 if name == "stop_start" else 60.0)

    chassis, t = car.chassis, seconds(truth)
    for start in np.arange(0.0, t[-1] - 1.5, 1.5):
        rows = part(truth, start, start + 1.5)
        clutches = rows["clutch1_torque_nm"] + rows["clutch2_torque_nm"]
        moved = rows[-1]["engine_speed_rad_s"] - rows[0]["engine_speed_rad_s"]
        turned = rows[-1]["damper_speed_rad_s"] - rows[0]["damper_speed_rad_s"]
        engine = car.engine_inertia_kgm2 * moved + car.damper.inertia_kgm2 * turned
        assert engine == pytest.approx(np.trapezoid(rows["engine_torque_nm"] - clutches, dx=1e-3), abs=0.2)
        body = chassis.mass_kg * chassis.wheel_radius_m**2 + 0.5 * chassis.wheel_inertia_kgm2
        rolled = rows[-1]["undriven_wheel_speed_rad_s"] - rows[0]["undriven_wheel_speed_rad_s"]
        spun = rows[-1]["wheel_speed_rad_s"] - rows[0]["wheel_speed_rad_s"]
        momentum = body * rolled + 0.5 * chassis.wheel_inertia_kgm2 * spun
        impulse = np.trapezoid(rows["output_torque_nm"] - rows["road_load_nm"], dx=1e-3)
        assert momentum == pytest.approx(impulse, abs=3.0)


@pytest.mark.parametrize("name", ["roll_back", "reverse", "creep", "hard_braking"])
def test_road_load_opposes_motion_in_both_directions(avante_vehicle: Vehicle, name: str) -> None:
    """T_v = r (m g sin α + sgn v (m g f cos α + brake) + ½ ρ c A v |v|), by hand."""
    car, truth = avante_vehicle, driven(avante_vehicle, name)
    v, chassis = speed(truth, car), car.chassis
    weight = chassis.mass_kg * STANDARD_GRAVITY
    rolling = chassis.rolling_resistance * weight * np.cos(truth["grade_rad"]) + truth["brake_n"]
    air = 0.5 * 1.2 * chassis.drag_coefficient * chassis.frontal_area_m2 * v * np.abs(v)
    expected = chassis.wheel_radius_m * (weight * np.sin(truth["grade_rad"]) + np.sign(v) * rolling + air)
    moving = np.abs(v) > 0.02
    moving[1:] &= np.abs(np.diff(truth["brake_n"])) < 1e-9  # a row has the brake of its end
    np.testing.assert_allclose(truth["road_load_nm"][moving], expected[moving], rtol=0.02, atol=1.0)
    standing = np.abs(v) < 1e-9
    assert np.abs(truth["road_load_nm"][standing]).max() <= np.abs(expected[standing]).max() + (
        chassis.wheel_radius_m * rolling[standing].max()
    )


def test_a_brake_stops_a_car_that_rolls_back_and_holds_it(car: Vehicle) -> None:
    """On the slope brake and rolling resistance point uphill, then just hold what the slope pulls."""
    back = replace(MANOEUVRES["roll_back"](car), duration_s=5.0, pedal=((0.0, 0.0),))
    truth = simulate(
        car, replace(back, brake_n=((0.0, 6000.0), (1.0, 6000.0), (1.2, 0.0), (2.5, 0.0), (2.6, 4000.0)))
    )
    v, t = speed(truth, car), seconds(truth)
    assert v[t == 2.5][0] < -0.8
    stopping = (t > 2.65) & (v < -0.1)
    assert np.all(np.diff(v[stopping]) > 0.0)
    assert np.abs(v[t > 4.0]).max() < 1e-9
    assert v.max() < 0.02
    held = part(truth, 4.8, 5.0)
    np.testing.assert_allclose(held["road_load_nm"], held["output_torque_nm"], atol=0.5)


def test_creep(car: Vehicle) -> None:
    truth = driven(car, "creep")
    v = speed(truth, car)
    assert truth["pedal"].max() == 0.0
    crept = part(truth, 6.0, 7.0)
    assert 1.2 < speed(crept, car).min() <= speed(crept, car).max() < 1.8
    assert np.all(crept["phase1"] == SLIPPING)
    assert np.ptp(speed(part(truth, 9.6, 10.1), car)) < 1e-9  # stopped between
    assert v.min() > -1e-3
    assert abs(v[-1]) < 1e-9


def test_roll_back(car: Vehicle) -> None:
    """Free on the slope it gains (g sin α − f g cos α) m / (m + J/r²); the clutch takes it up again."""
    truth = driven(car, "roll_back")
    v, t = speed(truth, car), seconds(truth)
    assert -1.5 < v.min() < -0.8
    assert v[-1] > 3.0
    assert np.count_nonzero(np.diff(np.sign(v[t > 1.3])) != 0) == 1  # through zero once, without chatter
    free = part(truth, 1.4, 2.3)
    chassis, gears = car.chassis, (car.gear(1), car.gear(2))
    turning = chassis.wheel_inertia_kgm2 + sum(
        gear.total_ratio**2 * car.shaft_inertia_kgm2(gear.shaft) for gear in gears
    )
    slope = np.sin(0.1) - chassis.rolling_resistance * np.cos(0.1)
    a = -STANDARD_GRAVITY * slope * chassis.mass_kg / (chassis.mass_kg + turning / chassis.wheel_radius_m**2)
    assert (speed(free, car)[-1] - speed(free, car)[0]) / 0.9 == pytest.approx(a, rel=0.04)  # gear losses, drag
    back = truth[(t > 2.8) & (v < -0.1)]
    assert np.all(back["shaft1_speed_rad_s"] < 0.0)
    caught = back[back["clutch1_torque_nm"] > 50.0]
    # First gear takes its power from the wheels, so that the losses raise the output torque.
    loss = car.gear_efficiency * car.final_drive_efficiency
    first, second = (through_gear(caught, car, number) for number in (1, 2))
    assert caught["output_torque_nm"].mean() == pytest.approx(first / loss + second * loss, rel=0.02)


def through_gear(rows: Rows, car: Vehicle, number: int) -> float:
    """Return what goes from an input shaft into its gear times the gear's ratio: the mean over all rows."""
    gear = car.gear(number)
    speeds = rows[f"shaft{gear.shaft}_speed_rad_s"]
    acceleration = (speeds[-1] - speeds[0]) / (rows["t_us"][-1] - rows["t_us"][0]) * 1e6
    torque = rows[f"clutch{gear.shaft}_torque_nm"].mean() - car.shaft_inertia_kgm2(gear.shaft) * acceleration
    return float(torque * gear.total_ratio)


def test_hill_hold(car: Vehicle) -> None:
    """4 s without brake at rest, the clutch slipping, its torque that of the slope within rolling resistance."""
    truth = driven(car, "hill_hold")
    held = part(truth, 4.0, 8.4)
    assert held["brake_n"].max() == 0.0
    assert np.abs(speed(held, car)).max() < 1e-3
    assert np.all(held["phase1"] == SLIPPING)
    assert held["engine_speed_rad_s"].min() > 120.0
    chassis = car.chassis
    slope = chassis.mass_kg * STANDARD_GRAVITY * np.sin(0.08) * chassis.wheel_radius_m
    rolling = chassis.rolling_resistance * chassis.mass_kg * STANDARD_GRAVITY * chassis.wheel_radius_m
    assert np.abs(held["output_torque_nm"] - slope).max() < rolling
    assert speed(truth, car).min() > -0.05
    assert speed(truth, car).max() > 5.0


def test_braked_coast_down(car: Vehicle) -> None:
    truth = driven(car, "braked_coast_down")
    braked = part(truth, 23.5, 36.0)
    used = [
        n for n in range(5, 0, -1) if np.any((braked[f"gear{car.gear(n).shaft}"] == n) & (phase(braked, car, n)))
    ]
    assert len(used) >= 3  # gears in which its clutch was locked
    rate = np.gradient(speed(braked, car), 1e-3)
    assert rate.mean() == pytest.approx(-1.3, abs=0.3)
    assert abs(speed(truth, car)[-1]) < 1e-9


def phase(rows: Rows, car: Vehicle, gear: int) -> NDArray[np.bool_]:
    return np.asarray(rows[f"phase{car.gear(gear).shaft}"] == LOCKED)


def test_hard_braking(car: Vehicle) -> None:
    truth = driven(car, "hard_braking")
    v, t = speed(truth, car), seconds(truth)
    braked = (t > 24.5) & (v > 2.0)
    assert np.gradient(v, 1e-3)[braked].mean() == pytest.approx(-8.0, abs=0.4)
    assert v[t > 23.9][0] > 21.0
    assert np.abs(v[t > 28.0]).max() < 1e-9


def test_kick_down(car: Vehicle) -> None:
    """First from fourth to second in steps, then from fifth to second without a clutch locked between."""
    truth = driven(car, "kick_down")
    first, second = part(truth, 18.0, 22.0), part(truth, 30.0, 32.4)
    for rows, before, passed in ((first, 4, {3}), (second, 5, set())):
        locked = [n for n in range(1, 6) if np.any((rows[f"gear{car.gear(n).shaft}"] == n) & phase(rows, car, n))]
        assert set(locked) == {before, 2} | passed
        assert rows[-1]["gear2"] == 2
        assert rows[-1]["phase2"] == LOCKED
        assert rows[-1]["engine_speed_rad_s"] > 1.8 * rows[0]["engine_speed_rad_s"]


def test_reverse(avante_vehicle: Vehicle, paper_vehicle: Vehicle) -> None:
    car, truth = avante_vehicle, driven(avante_vehicle, "reverse")
    v = speed(truth, car)
    assert v.min() < -5.0
    assert v.max() < 1e-3
    assert abs(v[-1]) < 1e-9
    pulling = part(truth, 7.0, 7.4)
    assert np.all((pulling["gear2"] == -1) & (pulling["phase2"] == LOCKED) & (pulling["gear1"] == 0))
    total = abs(car.gear(-1).total_ratio)
    np.testing.assert_allclose(pulling["shaft2_speed_rad_s"], -total * pulling["output_speed_rad_s"], rtol=1e-2)
    loss = car.gear_efficiency * car.final_drive_efficiency
    inner = pulling["clutch2_torque_nm"].mean() * total * loss
    accelerated = car.shaft_inertia_kgm2(2) * np.gradient(pulling["shaft2_speed_rad_s"], 1e-3).mean()
    assert pulling["output_torque_nm"].mean() == pytest.approx(-inner + accelerated * total * loss, rel=0.02)
    with pytest.raises(DctorqueError, match="reverse"):
        driven(paper_vehicle, "reverse")


def test_sailing(car: Vehicle) -> None:
    truth = driven(car, "sailing")
    sailed = part(truth, 20.5, 25.9)
    assert np.all((sailed["phase1"] == OPEN) & (sailed["phase2"] == OPEN))
    assert speed(sailed, car).min() > 14.0
    np.testing.assert_allclose(sailed["engine_speed_rad_s"], 800 * np.pi / 30, atol=8.0)
    again = part(truth, 30.0, 31.0)
    assert np.all((again["phase1"] == LOCKED) | (again["phase2"] == LOCKED))


def test_stop_start(car: Vehicle) -> None:
    truth = driven(car, "stop_start")
    off, again = part(truth, 17.0, 17.9), part(truth, 18.9, 19.0)
    assert np.abs(off["engine_speed_rad_s"]).max() < 0.1
    assert np.abs(off["engine_torque_nm"]).max() < 0.2
    assert np.abs(speed(off, car)).max() < 1e-9
    assert again["engine_speed_rad_s"].min() > 70.0
    assert truth["engine_speed_rad_s"].min() > -1e-6
    assert speed(truth, car)[-1] > 5.0


def test_wheel_spin(car: Vehicle) -> None:
    """While the wheels spin the tyre carries μ times its load, whatever the slip; then they roll again."""
    truth = driven(car, "wheel_spin")
    spinning = part(truth, 2.0, 4.9)
    v = speed(truth, car)
    wheel = truth["wheel_speed_rad_s"] * car.chassis.wheel_radius_m
    assert np.all(spinning["wheel_speed_rad_s"] > 2.0 * spinning["undriven_wheel_speed_rad_s"])
    undriven = 0.5 * car.chassis.wheel_inertia_kgm2 / car.chassis.wheel_radius_m**2
    force = 0.25 * 0.5 * car.chassis.mass_kg * STANDARD_GRAVITY
    road = spinning["road_load_nm"].mean() / car.chassis.wheel_radius_m
    a = np.gradient(speed(spinning, car), 1e-3).mean()
    assert a * (car.chassis.mass_kg + undriven) == pytest.approx(force - road, rel=0.01)
    t = seconds(truth)
    np.testing.assert_allclose(wheel[t > 8.0], v[t > 8.0], atol=0.3)


def test_infinite_friction_is_no_limit(paper_vehicle: Vehicle) -> None:
    drive = MANOEUVRES["creep"](paper_vehicle)
    dry = simulate(paper_vehicle, replace(drive, duration_s=4.0))
    rough = simulate(paper_vehicle, replace(drive, duration_s=4.0, friction=((0.0, 1e9),)))
    np.testing.assert_allclose(dry["output_torque_nm"], rough["output_torque_nm"], atol=1e-3)


def test_split_mu(car: Vehicle) -> None:
    """An open differential gives the dry wheel no more than the one on ice; that tyre carries μ times its load."""
    truth = driven(car, "split_mu")
    chassis = car.chassis
    left, right = (truth["wheel_speed_rad_s"] + side * truth["wheel_difference_rad_s"] for side in (1, -1))
    undriven, t = truth["undriven_wheel_speed_rad_s"], seconds(truth)
    spinning = (t > 2.8) & (t < 4.9)
    assert np.all(left[spinning] > 3.0 * right[spinning])
    np.testing.assert_allclose(right[spinning], undriven[spinning], rtol=0.02, atol=0.05)
    load = 0.5 * chassis.mass_kg * STANDARD_GRAVITY  # of the driven axle
    road = truth["road_load_nm"][spinning].mean() / chassis.wheel_radius_m
    inertia = 0.5 * chassis.wheel_inertia_kgm2 / chassis.wheel_radius_m**2
    a = np.gradient(undriven * chassis.wheel_radius_m, 1e-3)[spinning].mean()
    # The dry tyre also turns its own wheel, of which the torque of the wheel on ice is not less: a small part.
    assert a * (chassis.mass_kg + inertia) == pytest.approx(2.0 * 0.1 * 0.5 * load - road, rel=0.05)
    assert np.abs(truth["wheel_difference_rad_s"][t > 7.0]).max() < 0.01
    assert undriven[-1] * chassis.wheel_radius_m > 5.0


def test_wheels_on_equal_roads_are_one_wheel(paper_vehicle: Vehicle) -> None:
    """Two wheels behind a differential and one that stands for both: two models of the same car."""
    drive = replace(MANOEUVRES["wheel_spin"](paper_vehicle), duration_s=3.0)
    one, two = (simulate(paper_vehicle, d) for d in (drive, replace(drive, friction_right=drive.friction)))
    assert np.abs(two["wheel_difference_rad_s"]).max() < 1e-9
    np.testing.assert_allclose(two["wheel_speed_rad_s"], one["wheel_speed_rad_s"], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(two["tyre_heat_j"], one["tyre_heat_j"], rtol=1e-6, atol=1e-3)


def test_what_turns_costs_torque_without_any_load(car: Vehicle) -> None:
    """With spin losses the ledger closes, and J ω̇ = T_c − T_t/(i η) − c sgn ω − d ω of an input shaft."""
    shafts = tuple(replace(shaft, spin_loss_nm=1.5, spin_loss_nms_per_rad=0.012) for shaft in car.shafts)
    output = replace(car.output_shaft, spin_loss_nm=4.0, spin_loss_nms_per_rad=0.1)
    lossy = replace(car, shafts=(shafts[0], shafts[1]), output_shaft=output)
    truth = simulate(lossy, MANOEUVRES["roll_back"](car))
    assert np.abs(energy_residual_j(truth)).max() < 1e-5 * truth["engine_work_j"].max()
    assert truth["driveline_heat_j"][-1] > 1.05 * driven(car, "roll_back")["driveline_heat_j"][-1]
    gear = car.gear(1)
    forward, t = truth["shaft1_speed_rad_s"], seconds(truth)
    for start, end in ((1.6, 2.2), (6.0, 6.6)):
        rows = part(truth, start, end)
        assert np.all(rows["gear1"] == 1)
        w, T_t = rows["shaft1_speed_rad_s"], rows["transfer1_torque_nm"]
        assert np.all(np.sign(w) == (-1.0 if start < 2.0 else 1.0))
        drives = (T_t >= 0.0) == (w > 0.0)
        arm = np.where(drives, 1.0 / (gear.ratio * car.gear_efficiency), car.gear_efficiency / gear.ratio)
        turned = rows["clutch1_torque_nm"] - arm * T_t - 1.5 * np.sign(w) - 0.012 * w
        gained = lossy.shaft_inertia_kgm2(1) * (w[-1] - w[0])
        assert gained == pytest.approx(np.trapezoid(turned, dx=1e-3), abs=0.02)
    assert forward[t > 6.0].min() > 20.0
