"""Which gear suits the pedal and the speed."""

from __future__ import annotations

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.simulation.powertrain import Parameters


@compiled_without_allocation
def up_shift_speed(p: Parameters, gear: int, pedal: float) -> float:
    """Return the speed above which the next gear is taken, m/s."""
    row = p.up_shift[min(gear, p.up_shift.shape[0]) - 1]
    last = p.shift_pedal.size - 1
    if pedal <= p.shift_pedal[0]:
        return float(row[0])
    for i in range(last):
        if pedal <= p.shift_pedal[i + 1]:
            part = (pedal - p.shift_pedal[i]) / (p.shift_pedal[i + 1] - p.shift_pedal[i])
            return float(row[i] + part * (row[i + 1] - row[i]))
    return float(row[last])


@compiled_without_allocation
def wanted_gear(p: Parameters, lever: int, gear: int, pedal: float, v: float) -> int:
    """Return the gear to go to from ``gear`` at ``v`` in m/s, by ``lever`` (0 automatic, or a gear by hand)."""
    if gear < 0:
        return gear
    if lever > 0:  # a gear on the same shaft is reached over the one between
        if lever == gear or p.gear_shaft[lever] != p.gear_shaft[gear]:
            return lever
        return gear + 1 if lever > gear else gear - 1
    if gear < p.n_gears and v > up_shift_speed(p, gear, pedal):
        return gear + 1
    if gear > 1 and v < up_shift_speed(p, gear - 1, pedal) - p.shift_hysteresis:
        return gear - 1
    return gear
