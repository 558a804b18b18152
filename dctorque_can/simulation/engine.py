"""Net torque the engine can give and is asked for."""

from __future__ import annotations

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.simulation.powertrain import Parameters

_IDLE_GAIN = 2.0  # N·m per rad/s; with the lag's lead below, poles near 7 1/s on 0.23 kg·m²
CRANKED = 25.0  # rad/s; from here on the engine fires
_STARTER_TORQUE = 60.0  # N·m at the crankshaft, at rest
_STARTER_SPEED = 40.0  # rad/s without load
_LIMITER_BAND = 20.0  # rad/s in which the speed limiter takes the torque away


@compiled_without_allocation
def full_load(p: Parameters, w_e: float) -> float:
    """Return the greatest net torque at speed ``w_e``, N·m."""
    x = w_e / p.power_speed
    torque = p.power_torque * (p.full_load[0] + p.full_load[1] * x - p.full_load[2] * x * x)
    limiter = (p.speed_limit - w_e) / _LIMITER_BAND
    return float(max(closed(p, w_e), torque * min(1.0, max(0.0, limiter))))


@compiled_without_allocation
def closed(p: Parameters, w_e: float) -> float:
    """Return the net torque with the fuel cut, N·m (negative)."""
    return -(p.drag_nm + p.drag_nms * w_e) * min(1.0, max(0.0, w_e / 10.0))


@compiled_without_allocation
def driver_demand(p: Parameters, pedal: float, w_e: float) -> float:
    """Return the torque that the pedal asks for, N·m."""
    low = closed(p, w_e)
    share = 1.0 - (1.0 - min(1.0, max(0.0, pedal))) ** p.pedal_exponent
    return float(low + share * (full_load(p, w_e) - low))


@compiled_without_allocation
def starter(w_e: float) -> float:
    """Return the starter's torque at the crankshaft beyond the drag of an engine without fuel, N·m."""
    return _STARTER_TORQUE * max(0.0, 1.0 - w_e / _STARTER_SPEED)


@compiled_without_allocation
def told_without_fire(p: Parameters, w_e: float) -> float:
    """Return what the control unit takes for the net torque while nothing burns, N·m: drag, and no starter.

    It knows the drag of an engine that turns, and tells it of one that stands, too.
    """
    return -(p.drag_nm + p.drag_nms * w_e)


@compiled_without_allocation
def with_idle_control(p: Parameters, command: float, w_e: float, dw_e: float) -> float:
    """Return ``command``, or what keeps the engine at idle speed if that is more, within the engine's means."""
    idle = _IDLE_GAIN * (p.idle - w_e - p.torque_lag * dw_e)
    return min(full_load(p, w_e), max(closed(p, w_e), max(command, idle)))
