"""The three methods on the model's own motion: all give the truth, for a locked clutch a multiplier."""

from __future__ import annotations

import numpy as np
import pytest

from dctorque_can.driveline import clutch_torque
from dctorque_can.driveline.phases import ClutchPhase

from .lagrange import DAMPER, OUTPUT, SHAFT1, SHAFT2, gamma, lagrange, rounding
from .segments import (
    BODIES,
    SEGMENTS,
    compliant_accelerations,
    compliant_run,
    compliant_torques,
    lumped_run,
    lumped_torques,
)

OPEN, SLIPPING, LOCKED = ClutchPhase


def phases_of(s):
    return [LOCKED if s.locked == clutch else SLIPPING for clutch in (1, 2)]


def rounding_of_methods(s):
    """Return by how much rounding may part a method from the truth, N·m.

    The truth itself is known to `rounding`, and may come in from the other clutch times a ratio of both gears;
    beside it a method has at most 20 roundings of sums of torques, accelerations times inertia among them.
    """
    t, y = compliant_run(s)
    ratio = max(s.pair.R_1 / s.pair.R_2, s.pair.R_2 / s.pair.R_1)
    torques = np.abs(np.array(compliant_torques(s, t, y))).sum(axis=0).max()
    return (1.0 + ratio) * rounding(s, t, y)[1].max() + gamma(20) * torques


def known(s):
    """Return the motion, its accelerations, torques, slips, and the true clutch torques [2, n]."""
    t, y = compliant_run(s)
    accelerations = compliant_accelerations(s, t, y)
    slips = y[BODIES + DAMPER] - y[[BODIES + SHAFT1, BODIES + SHAFT2]]
    return t, accelerations, compliant_torques(s, t, y), slips, lagrange(s, t, y)[1]


@pytest.mark.parametrize("name", SEGMENTS)
def test_all_methods_give_the_truth(name):
    s = SEGMENTS[name]
    p, J_d, J_o = s.pair, s.vehicle.damper.inertia_kgm2, s.vehicle.output_shaft.inertia_kgm2
    t, a, (T_d, T_t1, T_t2, T_o, _, _, _), slips, truth = known(s)
    phases, capacities = phases_of(s), [s.capacity(1, t), s.capacity(2, t)]
    for clutch in (0, 1):
        if s.locked != clutch + 1:
            assert np.ptp(np.sign(slips[clutch])) == 0.0  # the segment is smooth

    first = clutch_torque.damper_side_torques(tuple(phases), tuple(capacities), tuple(slips), T_d, J_d, a[DAMPER])
    second = [
        clutch_torque.shaft_side_torque(phases[i], capacities[i], slips[i], T_t, i_t, J, a[shaft])
        for i, (T_t, i_t, J, shaft) in enumerate([(T_t1, p.i_t1, p.J_1, SHAFT1), (T_t2, p.i_t2, p.J_2, SHAFT2)])
    ]
    motion = a[OUTPUT], a[SHAFT1], a[SHAFT2]
    from_other = [
        clutch_torque.gearbox_side_torque1(p, J_o, *motion, truth[1], T_o),
        clutch_torque.gearbox_side_torque2(p, J_o, *motion, truth[0], T_o),
    ]
    from_none = [
        method(p, J_o, *motion, T_o, T_d, J_d, a[DAMPER])
        for method in (clutch_torque.whole_gearbox_torque1, clutch_torque.whole_gearbox_torque2)
    ]
    assert np.ptp(truth) > 30.0
    allowed = rounding_of_methods(s)
    assert allowed < 1e-6
    for method in (first, second, from_other, from_none):
        assert np.abs(np.array(method) - truth).max() <= allowed


@pytest.mark.parametrize("name", SEGMENTS)
def test_the_shaft_side_needs_no_phase(name):
    """(20) and (21) as "engaged" hold for a slipping clutch too: they are (12) and (13)."""
    s = SEGMENTS[name]
    p = s.pair
    allowed = rounding_of_methods(s)
    _, a, (_, T_t1, T_t2, *_), slips, truth = known(s)
    for i, (T_t, i_t, J, shaft) in enumerate([(T_t1, p.i_t1, p.J_1, SHAFT1), (T_t2, p.i_t2, p.J_2, SHAFT2)]):
        torque = clutch_torque.shaft_side_torque(LOCKED, 0.0, slips[i], T_t, i_t, J, a[shaft])
        assert np.abs(torque - truth[i]).max() <= allowed


def test_phases_choose_row_by_row():
    """One call over all phases is one call for each; with both locked the damper side knows nothing."""
    rows = [(one, two) for one in ClutchPhase for two in ClutchPhase]
    one, two = (np.array(column) for column in zip(*rows, strict=True))
    capacities, slips, T_d, J_d, dw_d = (50.0, 80.0), (3.0, -2.0), 100.0, 0.1, 40.0
    together = clutch_torque.damper_side_torques((one, two), capacities, slips, T_d, J_d, dw_d)
    expected = {
        (OPEN, OPEN): (0.0, 0.0),
        (OPEN, SLIPPING): (0.0, -80.0),
        (OPEN, LOCKED): (0.0, 96.0),
        (SLIPPING, OPEN): (50.0, 0.0),
        (SLIPPING, SLIPPING): (50.0, -80.0),
        (SLIPPING, LOCKED): (50.0, 46.0),
        (LOCKED, OPEN): (96.0, 0.0),
        (LOCKED, SLIPPING): (176.0, -80.0),
        (LOCKED, LOCKED): (np.nan, np.nan),
    }
    np.testing.assert_array_equal(np.transpose(together), [expected[row] for row in rows])
    alone = [clutch_torque.damper_side_torques(row, capacities, slips, T_d, J_d, dw_d) for row in rows]
    np.testing.assert_array_equal(np.transpose(together), alone)
    assert all(isinstance(torque, float) for pair in alone for torque in pair)


@pytest.mark.parametrize("name", ["paper, 1 locked", "avante, 1 locked"])
def test_a_locked_clutch_pulls_back_when_the_other_takes_more_than_the_engine_gives(name):
    """First gear locked, clutch 2 slipping with more than the damper brings: T_c1 < 0, in the lumped model too."""
    s = SEGMENTS[name]
    t, _, (T_d, *_), _, truth = known(s)
    pulls_back = T_d < s.capacity(2, t) - 40.0
    assert pulls_back.any()
    assert truth[0][pulls_back].max() < 0.0

    t, y = lumped_run(s)
    T_d, _, _, T_c1, _ = lumped_torques(s, t, y)
    pulls_back = T_d < s.capacity(2, t) - 40.0
    assert pulls_back.any()
    assert T_c1[pulls_back].max() < 0.0
