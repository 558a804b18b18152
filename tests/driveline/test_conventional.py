"""Section 2.1: (4) against (3), closed forms, its energy, and the compliant model with ever stiffer shafts."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dctorque_can.driveline import conventional
from dctorque_can.driveline.gear_pair import GearPair

from .segments import (
    AVANTE,
    PAPER,
    SEGMENTS,
    compliant_run,
    compliant_torques,
    integrate,
    lumped_accelerations,
    lumped_run,
    lumped_start,
    lumped_torques,
)

torques = st.floats(-1000.0, 1000.0)


@given(torques, torques, torques, st.sampled_from([(1, 2), (3, 2), (3, 4), (5, 4)]))
def test_on_one_final_drive_the_fourth_equation_is_the_third_times_the_ratios(T_c1, T_c2, T_o, gears):
    """(4) = (3) · i_t1/i_t2, and both accelerations are those of shafts that turn as one."""
    pair = GearPair.of(PAPER, *gears)
    third = conventional.input_shaft1_acceleration(T_c1, T_c2, T_o, pair)
    fourth = conventional.input_shaft2_acceleration(T_c1, T_c2, T_o, pair)
    scale = 1e-9 * (1.0 + abs(third) + abs(fourth))
    assert fourth * pair.J_e2 == pytest.approx(third * pair.J_e1 * pair.i_t1 / pair.i_t2, rel=1e-9, abs=1e-9)
    assert fourth == pytest.approx(third * pair.i_t2 / pair.i_t1, abs=scale)


@given(torques, torques, torques, st.sampled_from([(1, 2), (3, 2), (3, 4), (7, 6), (1, -1)]))
def test_on_two_final_drives_both_shafts_turn_as_one(T_c1, T_c2, T_out, gears):
    """One torque at the output shaft, brought before each final drive, moves both shafts in the ratio R_2/R_1."""
    pair = GearPair.of(AVANTE, *gears)
    third = conventional.input_shaft1_acceleration(T_c1, T_c2, T_out / pair.i_f1, pair)
    fourth = conventional.input_shaft2_acceleration(T_c1, T_c2, T_out / pair.i_f2, pair)
    # power balance of the rigid pair at any output speed
    one, two = pair.i_t1 * pair.i_f1, pair.i_t2 * pair.i_f2
    output = (one * T_c1 + two * T_c2 - T_out) / (one**2 * pair.J_1 + two**2 * pair.J_2)
    assert (third, fourth) == pytest.approx((one * output, two * output), rel=1e-9, abs=1e-9)


def test_road_load_by_hand():
    chassis = PAPER.chassis  # 1600 kg, 0.312 m, K_rr .015, C_d .4, A 3
    flat = 0.312 * (0.015 * 1600 * 9.80665 + 0.5 * 1.2 * 0.4 * 3.0 * 20.0**2)
    steep = 0.312 * 1600 * 9.80665
    wheel = 20.0 / 0.312
    assert conventional.road_load(chassis, 0.0, wheel) == pytest.approx(flat, rel=1e-12)
    assert conventional.road_load(chassis, 0.0, -wheel) == pytest.approx(-flat, rel=1e-12)
    assert conventional.road_load(chassis, np.pi / 2, 0.0) == pytest.approx(steep, rel=1e-12)
    both = conventional.road_load(chassis, np.array([0.0, 0.1]), np.array([wheel, 0.0]))
    np.testing.assert_allclose(both, [flat, steep * np.sin(0.1)], rtol=1e-12)


def test_capacity_and_friction_by_hand():
    clutch = PAPER.clutches[0]  # four surfaces, 0.13 m, kinetic 0.30
    capacity = conventional.torque_capacity(clutch, np.array([0.0, 1000.0]))
    np.testing.assert_allclose(capacity, [0.0, 156.0], rtol=1e-12)
    np.testing.assert_array_equal(
        conventional.slipping_clutch_torque(100.0, np.array([3.0, 0.0, -2.0])), [100.0, 0.0, -100.0]
    )


@pytest.mark.parametrize("name", SEGMENTS)
def test_energy_closes(name):
    """With the own inertia of every part: what (3) calls J_e1 must hold the energy of both shafts."""
    s = SEGMENTS[name]
    v, p = s.vehicle, s.pair
    r = p.R_2 / p.R_1
    k_o, b_o = v.output_shaft.stiffness_nm_per_rad, v.output_shaft.damping_nms_per_rad

    def power(t, y):
        _, _, T_v, T_c1, T_c2 = lumped_torques(s, t, y)
        _, _, _, _, w_e, w_d, w_1, w_w = y[:8]
        heat = v.damper.damping_nms_per_rad * (w_e - w_d) ** 2 + b_o * (w_1 / p.R_1 - w_w) ** 2
        heat += T_c1 * (w_d - w_1) + T_c2 * (w_d - r * w_1)
        return [s.engine_torque(t) * w_e - T_v * w_w - heat]

    def right_hand_side(t, y):
        return np.concatenate((y[4:8], lumped_accelerations(s, t, y), power(t, y)))

    def stored(y):
        th_e, th_d, th_1, th_w, w_e, w_d, w_1, w_w = y[:8]
        kinetic = v.engine_inertia_kgm2 * w_e**2 + v.damper.inertia_kgm2 * w_d**2
        kinetic += p.J_1 * w_1**2 + p.J_2 * (r * w_1) ** 2 + v.chassis.inertia_kgm2 * w_w**2
        elastic = v.damper.stiffness_nm_per_rad * (th_e - th_d) ** 2 + k_o * (th_1 / p.R_1 - th_w) ** 2
        return 0.5 * (kinetic + elastic)

    _, y = integrate(right_hand_side, [*lumped_start(s), 0.0])
    exchanged = y[8]
    assert np.ptp(exchanged) > 500.0
    np.testing.assert_allclose(stored(y) - stored(y[:, 0]), exchanged, atol=1e-3)


@pytest.mark.parametrize("name", SEGMENTS)
def test_stiff_transfer_shafts_lead_to_the_lumped_model(name):
    """All torques of section 2.2 go to those of 2.1 as 1/k_t, once J_o joins the rigid shafts."""
    s = SEGMENTS[name]
    rigid = s.pair
    rigid = replace(rigid, J_1=rigid.J_1 + s.vehicle.output_shaft.inertia_kgm2 / rigid.R_1**2)

    t, y = lumped_run(s, rigid)
    T_d, T_o, _, T_c1, T_c2 = lumped_torques(s, t, y, rigid)
    limit = np.array(np.broadcast_arrays(T_d, rigid.i_f1 * T_o, T_c1, T_c2))
    late = t > 0.1
    errors = []
    for factor in (10.0, 100.0, 1000.0):
        stiff = s.stiffened(factor)
        t, y = compliant_run(stiff)
        T_d, _, _, T_o, _, T_c1, T_c2 = compliant_torques(stiff, t, y)
        difference = np.array(np.broadcast_arrays(T_d, T_o, T_c1, T_c2)) - limit
        errors.append(np.abs(difference[:, late]).max(axis=1))
    for soft, stiff in pairwise(errors):
        np.testing.assert_allclose(stiff, soft / 10.0, rtol=0.1, atol=1e-4)
