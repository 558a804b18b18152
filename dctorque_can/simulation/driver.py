"""A driver who follows a speed."""

from __future__ import annotations

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.simulation.powertrain import Parameters

_PEDAL_RATE = 0.6  # 1/s
_BRAKE_RATE = 1.0  # of the weight, 1/s
_COASTING = -0.6  # m/s²; harder deceleration needs the brake


@compiled_without_allocation
def follow(
    p: Parameters,
    aim: float,
    later: float,
    v: float,
    integral: float,
    last_pedal: float,
    last_brake: float,
    dt: float,
) -> tuple[float, float, float]:
    """Return pedal, braking force in N, and the driver's memory in m/s².

    Args:
        p: parameters.
        aim: speed wanted now, m/s.
        later: speed wanted in half a second, m/s.
        v: speed, m/s.
        integral: memory of the last step, m/s².
        last_pedal: of the last step, 0..1.
        last_brake: of the last step, N.
        dt: step, s.
    """
    error = later - v
    integral = min(1.5, max(-0.5, integral + 0.15 * error * dt))
    acceleration = 0.6 * error + integral + 2.0 * (later - aim)
    pedal = min(0.9, max(0.0, 0.05 + 0.22 * acceleration))
    brake = min(0.6 * p.weight, max(0.0, p.mass * (_COASTING - acceleration)))
    if aim < 0.05 and later < 0.05:  # wants to stand
        pedal, brake, integral = 0.0, max(brake, 0.15 * p.weight), 0.0
    if brake > 0.0:
        pedal = 0.0
    step = _PEDAL_RATE * dt
    pedal = min(last_pedal + step, max(last_pedal - 4.0 * step, pedal))
    if pedal > 0.0 and v < 0.1:
        brake = 0.0
    step = _BRAKE_RATE * p.weight * dt
    brake = min(last_brake + step, max(last_brake - 4.0 * step, brake))
    return pedal, brake, integral
