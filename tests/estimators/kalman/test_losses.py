"""What is lost in the gearbox: which way with the load, and in whatever turns."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from dctorque_can.estimators.kalman import filter as kalman
from dctorque_can.estimators.kalman import losses, model
from dctorque_can.estimators.kalman.model import CAR, STEPS_US, N, State

from .test_gearbox import DESIGN, LOCKED, OPEN, SLIPPING, VEHICLE, new_filter


def test_losses_do_not_follow_the_noise():
    """A locked clutch drives down to −(2 N·m + σ), and is driven up to as much; an open one has no band."""
    k = new_filter()
    f = k.state[0]
    decisions = []
    for torque in (-11.9, -12.1, 11.9, 12.1):
        f["x"][State.T_C1] = torque
        f["P"][State.T_C1, State.T_C1] = 10.0**2
        losses.decide_directions(f, k.tuning[0], LOCKED, OPEN)
        decisions.append(bool(f["drives"][0]))
    assert decisions == [True, False, False, True]
    f["x"][State.T_C2] = -0.1
    losses.decide_directions(f, k.tuning[0], LOCKED, OPEN)
    assert not f["drives"][1]


def test_friction_follows_the_slip():
    """With 50 rad/s of slip a slipping clutch drives, whatever the filter thinks of its torque."""
    k = new_filter()
    f = k.state[0]
    f["x"][State.T_C1] = -60.0
    losses.decide_directions(f, k.tuning[0], SLIPPING, OPEN)
    assert f["drives"][0]
    f["x"][State.W_E] = 100.0  # slower than the shaft
    losses.decide_directions(f, k.tuning[0], SLIPPING, OPEN)
    assert not f["drives"][0]


def test_turned_losses_do_not_prove_zero_torque():
    """The losses turn at −20 ± 10 N·m: what is known of clutch and output torque together must not pull to zero.

    Before, T_o = R η T_c was known to 1 N·m; then T_o = R T_c/η is told with as little doubt.
    """
    k = new_filter()
    f, gear = k.state[0], VEHICLE.gear(1)
    efficiency = VEHICLE.gear_efficiency * VEHICLE.final_drive_efficiency
    stiffness = VEHICLE.output_shaft.stiffness_nm_per_rad
    line = np.zeros(N)
    line[[State.T_C1, State.TH_O]] = 1.0, gear.total_ratio * efficiency / stiffness
    f["P"][:] = 10.0**2 * np.outer(line, line) + 1e-9 * np.eye(N)
    f["x"][:] = -20.0 * line
    losses.decide_directions(f, k.tuning[0], LOCKED, OPEN)
    assert not f["drives"][0]
    H = np.zeros(N)
    H[State.TH_O], H[State.T_C1] = stiffness, -gear.total_ratio / efficiency
    gain = f["P"] @ H / (H @ f["P"] @ H + 1.0)
    x = f["x"] - gain * (H @ f["x"])
    assert x[State.T_C1] == pytest.approx(-20.0, abs=10.0)


@pytest.mark.parametrize(("shaft", "state"), [(0, State.W_C1), (1, State.W_C2), (2, State.W_O)])
def test_a_spin_loss_turns_its_shaft_back(shaft, state):
    """The response to 1 N·m on one shaft is ∫ exp(A s) B ds, from scipy's exponential of [[A, B], [0, 0]]."""
    tables = model.tables(VEHICLE, DESIGN, 17)
    A, _ = model.continuous(VEHICLE, DESIGN, 1, 2, (False, False))
    B = np.zeros(N)
    output = max(VEHICLE.output_shaft.inertia_kgm2, 1e-4)
    B[state] = -1.0 / (output if shaft == 2 else VEHICLE.shaft_inertia_kgm2(shaft + 1))
    for step in (0, len(STEPS_US) - 1):
        both = np.zeros((N + 1, N + 1))
        both[:N, :N], both[:N, N] = A, B
        expected = expm(both * STEPS_US[step] * 1e-6)[list(CAR), N]
        found = tables.steps[tables.row[2, 3], step]["losses"][shaft]
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


def test_told_losses_act_on_what_turns():
    """A free shaft of 200 rad/s with 2 N·m and 0.01 N·m·s/rad loses 4 N·m/J of its speed, back and forth."""
    shafts = (replace(VEHICLE.shafts[0], spin_loss_nm=2.0, spin_loss_nms_per_rad=0.01), VEHICLE.shafts[1])
    lossy = replace(VEHICLE, shafts=shafts)
    for speed in (200.0, -200.0):
        found = []
        for vehicle in (VEHICLE, lossy):
            k = kalman.new(vehicle, DESIGN)
            f = k.state[0]
            kalman.start(f, k.tuning[0], 100.0, speed, 0.0, 0.0, 0.0)
            kalman.predict(f, k.tables, k.tuning[0], OPEN, OPEN, False, False, 1000)
            found.append(f["x"].copy())
        slowed = found[1] - found[0]
        assert slowed[State.W_C1] == pytest.approx(-np.sign(speed) * 4e-3 / VEHICLE.shaft_inertia_kgm2(1))
        assert np.count_nonzero(slowed) == 1


def test_untold_losses_are_in_sigma_of_the_output():
    """Both shafts have their error at once: Σ |R| √(c² + (d ω)²), nothing from a shaft in neutral or at rest."""
    k = new_filter()
    f, tuning = k.state[0], k.tuning[0]
    f["sigma_o"] = 0.0
    losses.admit_spin_losses(f, tuning)
    c, d = DESIGN.spin_loss_error_nm, DESIGN.spin_loss_error_nms_per_rad
    first, second = (VEHICLE.gear(number).total_ratio for number in (1, 2))
    assert f["sigma_o"] == pytest.approx(first * np.hypot(c, 150.0 * d) + second * np.hypot(c, 100.0 * d))
    f["gear"][:], f["sigma_o"] = (0, 2), 0.0
    f["x"][State.W_C2] = 0.0
    losses.admit_spin_losses(f, tuning)
    assert f["sigma_o"] == 0.0
