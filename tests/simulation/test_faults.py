"""Gearboxes that do what they should not: shifts taken back, tie-ups, judder, faults of clutches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dctorque_can.driveline.parameters import Vehicle
from dctorque_can.simulation.drive import mixed_drive, simulate
from dctorque_can.simulation.manoeuvres import MANOEUVRES, friction_drift

from .driven import LOCKED, OPEN, SLIPPING, Rows, driven, part, seconds, speed


def test_aborted_shift(car: Vehicle) -> None:
    """The clutch of third gear takes over and gives back; once the engine has left the speed of second gear."""
    truth = driven(car, "aborted_shift")
    for start, end, left in ((13.0, 14.0, False), (18.0, 20.5, True)):
        rows = part(truth, start, end)
        assert rows["clutch1_torque_nm"].max() > 40.0
        assert np.all(rows["gear1"] == 3)
        assert np.all(rows["gear2"] == 2)
        behind = rows["shaft2_speed_rad_s"] - rows["engine_speed_rad_s"]
        assert (behind.max() > 40.0) == left
        assert not np.any(rows["phase1"] == LOCKED)
        assert rows[-1]["phase1"] == OPEN
        assert rows[-1]["phase2"] == LOCKED
    assert part(truth, 24.0, 25.0)["gear2"].max() == 2  # third gear never was


def test_tie_up(car: Vehicle) -> None:
    """Both clutches carry more than the engine gives, against each other, and brake the car."""
    truth = driven(car, "tie_up")
    tied = part(truth, 13.45, 13.65)
    assert tied["clutch2_torque_nm"].max() < -60.0
    assert tied["clutch1_torque_nm"].min() > 100.0
    assert tied["clutch1_capacity_nm"].min() > 100.0
    assert tied["clutch2_capacity_nm"].min() > 100.0
    # What goes round is through both clutches, not through the engine.
    engine, damper = (
        tied[f"{name}_speed_rad_s"][-1] - tied[f"{name}_speed_rad_s"][0] for name in ("engine", "damper")
    )
    slowed = car.engine_inertia_kgm2 * engine + car.damper.inertia_kgm2 * damper
    carried = tied["clutch1_torque_nm"] + tied["clutch2_torque_nm"]
    assert carried.mean() == pytest.approx(tied["engine_torque_nm"].mean() - slowed / 0.2, abs=1.0)
    before = part(truth, 12.5, 12.9)
    assert part(truth, 13.25, 13.65)["output_torque_nm"].mean() < 0.7 * before["output_torque_nm"].mean()
    assert np.all(part(truth, 16.0, 16.9)["phase1"] == LOCKED)  # and then the shift is done
    assert np.all(part(truth, 20.0, 22.0)["gear2"] == 4)


def test_hard_synchroniser(car: Vehicle) -> None:
    """30 N·m turn the shaft of an open clutch six times, while the other clutch stays locked in third gear."""
    truth = driven(car, "hard_synchroniser")
    rows = part(truth, 13.5, 24.0)
    assert np.all(rows["phase1"] == LOCKED)
    assert np.all(rows["phase2"] == OPEN)
    assert np.all(rows["gear1"] == 3)
    inertia = car.shaft_inertia_kgm2(2)
    torque = inertia * np.diff(rows["shaft2_speed_rad_s"]) / 1e-3
    quick = rows["changing2"][1:] & rows["changing2"][:-1] & (np.abs(torque) > 10.0)
    turned = np.flatnonzero(np.diff(quick.astype(int)) == 1)
    assert len(turned) == 6
    drag = car.clutches[1].drag_nms_per_rad * 250.0  # its slip is below 250 rad/s
    assert np.median(np.abs(torque[quick])) == pytest.approx(30.0, abs=0.5 + drag)


def test_judder(car: Vehicle) -> None:
    """The torque of the slipping clutch swings at 8 to 12 Hz, by the share that its capacity does."""
    truth = driven(car, "judder")
    for start, end in ((2.0, 6.0), (10.0, 12.0)):
        rows = part(truth, start, end)
        assert np.all(rows["phase1"] == SLIPPING)
        torque = rows["clutch1_torque_nm"]
        t = seconds(rows) - start
        swing = torque - np.polynomial.Polynomial.fit(t, torque, 5)(t)
        power = np.abs(np.fft.rfft(swing * np.hanning(len(t)))) ** 2
        frequency = np.fft.rfftfreq(len(t), 1e-3)
        inside = (frequency > 7.5) & (frequency < 12.5)
        assert power[inside].sum() > 0.8 * power[frequency > 2.0].sum()
        assert 1.2 < swing.std() < 0.08 * torque.max()


def shown(rows: Rows, car: Vehicle, i: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return capacity of clutch ``i`` over what its position says, and the kissing point that it has, mm."""
    clutch = car.clutches[i - 1]
    full = clutch.surfaces * clutch.friction_kinetic * clutch.effective_radius_m * clutch.max_normal_force_n
    position, capacity = rows[f"clutch{i}_position_mm"], rows[f"clutch{i}_capacity_nm"]
    closed = capacity > 20.0
    share, travel = capacity[closed] / full, (position[closed] - 3.0) / 7.0
    return share / travel**1.5, position[closed] - 7.0 * share ** (2.0 / 3.0)


def test_friction_fading(avante_vehicle: Vehicle) -> None:
    """Clutch 1 loses 30 % of its friction with its heat, and little of it before the second start."""
    car, truth = avante_vehicle, driven(avante_vehicle, "friction_fading")
    lost = [1.0 - shown(part(truth, start, start + 5.5), car, 1)[0] for start in (2.0, 18.0, 34.0)]
    assert lost[0].max() < 0.2 < lost[1].max() < lost[2].max() + 1e-9
    assert lost[2].max() == pytest.approx(0.3, abs=0.01)
    assert shown(truth, car, 2)[0].min() > 0.9
    held = [np.abs(speed(part(truth, start + 2.0, start + 5.0), car)).max() for start in (2.0, 18.0, 34.0)]
    assert max(held) < 0.01  # the control presses harder
    for start in (12.0, 28.0, 44.0):
        assert speed(part(truth, start, start + 1.0), car).max() > 5.0


def test_touch_point_drift(avante_vehicle: Vehicle) -> None:
    """At the end clutch 1 carries torque where the vehicle file has it open; clutch 2 is as it was."""
    car, truth = avante_vehicle, driven(avante_vehicle, "touch_point_drift")
    first, last = part(truth, 0.0, 5.0), part(truth, 61.0, 70.0)
    np.testing.assert_allclose(shown(first, car, 1)[1], 3.0, atol=0.01)
    np.testing.assert_allclose(shown(last, car, 1)[1], 2.3, atol=0.01)
    np.testing.assert_allclose(shown(truth, car, 2)[1], 3.0, atol=0.01)
    touching = last[(last["clutch1_position_mm"] < 2.8) & (last["clutch1_capacity_nm"] > 1.0)]
    assert len(touching) > 500
    assert np.abs(touching["clutch1_torque_nm"]).max() > 1.0


def test_a_synchroniser_overcomes_the_drag_of_its_clutch(paper_vehicle: Vehicle) -> None:
    """A drag of 0.03 N·m·s/rad, as cold oil has it, makes it slower; no clutch is closed on a shaft in neutral."""
    clutches = tuple(replace(clutch, drag_nms_per_rad=0.03) for clutch in paper_vehicle.clutches)
    car = replace(paper_vehicle, clutches=(clutches[0], clutches[1]))
    truth = simulate(car, MANOEUVRES["sailing"](car))
    for i in (1, 2):
        changing = np.flatnonzero(np.diff(np.concatenate([[0], truth[f"changing{i}"].astype(int), [0]])))
        assert np.ptp(changing.reshape(-1, 2), axis=1).max() < 700  # ms
        assert not np.any((truth[f"gear{i}"] == 0) & (truth[f"phase{i}"] == LOCKED))


def test_friction_drift(avante_vehicle: Vehicle) -> None:
    """Both clutches lose 30 % of their friction until the end, steadily."""
    drive = friction_drift(mixed_drive(avante_vehicle, 1, 180.0))
    truth = simulate(avante_vehicle, replace(drive, duration_s=60.0))
    for i in (1, 2):
        left = 1.0 - 0.3 * seconds(truth)[truth[f"clutch{i}_capacity_nm"] > 20.0] / 180.0
        np.testing.assert_allclose(shown(truth, avante_vehicle, i)[0], left, atol=1e-3)
    assert np.ptp(left) > 0.05
