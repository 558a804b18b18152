"""One clutch's characteristic, learned recursively: an extended Kalman filter over the nodes of its map.

What a slipping clutch carries is its capacity. At the actuation x, which changes by ẋ,

    |T| = (1 + g) e^λ (1 + β ϑ + γ ln(v/v_0)) C(x − ξ − τ ẋ − ½ h s(ẋ)) + o

    C     straight between the nodes of a grid
    λ, ξ  how friction and touch point have changed since C was learned: random walks
    β, γ  friction against temperature ϑ (or stored heat) and slip v
    τ, h  time by which estimate and actuation are apart; hysteresis, open to closed (s: −1 … 1)
    g, o  gain and offset of the estimated torque itself

g and o last: they are never observed apart from C and so stay in its σ, however often the clutch slips (a Schmidt
filter's "considered" parameters: S. F. Schmidt, in Advances in Control Systems 3, 1966). What is noise of the
estimate counts by its standard deviation, once in the time for which it lasts.

The products of states need care where C is not known yet: at C = 0 a gain would change nothing, and its error
would seem to be none. So the update is iterated once (Jazwinski, Stochastic Processes and Filtering Theory, 1970,
section 8.3).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dctorque_can.clutch_maps import prior
from dctorque_can.clutch_maps.settings import NODES, Actuation, MapSettings
from dctorque_can.clutch_maps.windows import WINDOW_US

Floats = NDArray[np.float64]

FRICTION, GAIN, OFFSET, HEAT, SLIP, SHIFT, LAG, HYSTERESIS = range(NODES, NODES + 8)
STATES = NODES + 8

SLIP_0_RAD_S = 50.0  # at which the map holds

_INDEPENDENT_S = 0.2  # after which an estimate counts as another one
_SETTLES_S = 0.01  # σ of the time by which an estimate may be apart beside τ, where the torque changes fast
_CAUTION_S = 0.5  # of slipping, over which surprises are remembered
_FRICTION_SIGMA, _LAG_SIGMA_S, _HEAT_SIGMA, _SLIP_SIGMA = 0.02, 0.006, 0.2, 0.03
_HYSTERESIS_SHARE, _FAST_PER_S = 0.3, 0.3  # of the touch error
_LONGEST_S = 120.0  # that counts for drift: a clutch that does not slip neither wears nor warms
_GATE = 6.0  # standard deviations


class Learner:
    """The state of one clutch.

    Args:
        actuation: of the clutch.
        capacity_nm: S, by the vehicle file.
        settings: of all maps.

    Attributes:
        left: actuation of the first node, times the closing sign.
        span: from the first to the last node.
        x: states ``[STATES]``.
        P: their covariance ``[STATES, STATES]``.
        samples: independent estimates that each node has seen ``[NODES]``.
        seen: least and largest actuation that taught.
        refused: observations beyond the gate.
        taken: observations that taught.
        unrest: mean of what innovations squared are over what they should be, recently.
        key: time of the last window that it took, µs; None before the first.
    """

    def __init__(self, actuation: Actuation, capacity_nm: float, settings: MapSettings) -> None:
        self._actuation, self._settings = actuation, settings
        self.capacity_nm = capacity_nm
        touch = actuation.closing_sign * actuation.touch_point
        self.left = touch - 2.0 * actuation.touch_error
        self.span = 8.0 * actuation.touch_error
        self.x = np.zeros(STATES)
        self.P = np.zeros((STATES, STATES))
        u = np.linspace(0.0, 1.0, NODES)
        self._prior = prior.covariance(u, u)
        self.P[:NODES, :NODES] = capacity_nm**2 * self._prior
        e = actuation.touch_error
        sigmas = {
            FRICTION: 1e-6,
            SHIFT: 1e-6 * e,
            GAIN: settings.torque_error_share,
            OFFSET: settings.torque_error_nm,
            HEAT: _HEAT_SIGMA,
            SLIP: _SLIP_SIGMA,
            LAG: _LAG_SIGMA_S,
            HYSTERESIS: _HYSTERESIS_SHARE * e,
        }
        for state, sigma in sigmas.items():
            self.P[state, state] = sigma**2
        self.samples = np.zeros(NODES)
        self.seen = (math.inf, -math.inf)
        self.refused = self.taken = 0
        self.unrest = 1.0
        self.key: int | None = None

    @property
    def grid(self) -> Floats:
        """Actuation of the nodes ``[NODES]``, times the closing sign."""
        return self.left + np.linspace(0.0, self.span, NODES)

    def take(
        self, key: int, x: float, rate: float, torque: float, sigma: float, slip: float, theta: float
    ) -> float | None:
        """Learn from one window, and return by how much it surprised, N·m; None: it was beyond the gate.

        Args:
            key: its time, µs, which does not fall.
            x: actuation, times the closing sign.
            rate: its change, 1/s.
            torque: carried in the direction of the slip, N·m.
            sigma: its standard deviation, N·m.
            slip: magnitude, rad/s.
            theta: ϑ.
        """
        self._drift(key)
        while x > self.left + self.span:
            self._double()
        before = self.x
        jacobian, expected, steepness = self._model(x, rate, slip, theta)
        noise = sigma**2 + (steepness * abs(rate) * _SETTLES_S) ** 2
        gain = self.P @ jacobian
        known = float(jacobian @ gain)
        innovation = torque - expected
        ratio = innovation**2 / (known + noise)
        self.unrest += (WINDOW_US * 1e-6 / _CAUTION_S) * (min(ratio, 9.0) - self.unrest)
        if ratio > _GATE**2:
            self.refused += 1
            return None
        self.taken += 1
        self.x = before + gain * (innovation / (known + noise))
        if known > noise:  # the map is less sure than the estimate: the Jacobian is that of what it becomes
            jacobian, expected, steepness = self._model(x, rate, slip, theta)
            noise = sigma**2 + (steepness * abs(rate) * _SETTLES_S) ** 2
            gain = self.P @ jacobian
            known = float(jacobian @ gain)
            left = torque - expected - float(jacobian @ (before - self.x))
            self.x = before + gain * (left / (known + noise))
        self.P -= np.outer(gain, gain) / (known + noise)
        self.P = 0.5 * (self.P + self.P.T)
        weights = jacobian[:NODES] / max(float(jacobian[:NODES].sum()), 1e-9)
        self.samples += weights * (WINDOW_US * 1e-6 / _INDEPENDENT_S)
        self.seen = min(self.seen[0], x), max(self.seen[1], x)
        return innovation

    def rest(self) -> None:
        """Let an unknown time pass, as it does between two drives."""
        self.key, self.unrest = None, 1.0
        self._walk(_LONGEST_S / 3600.0)

    def _drift(self, key: int) -> None:
        """Let time pass: friction and touch point walk, faster when they have surprised."""
        seconds = 0.0 if self.key is None else min((key - self.key) * 1e-6, _LONGEST_S)
        self.key = key
        self._walk(seconds / 3600.0 * max(self.unrest, 1.0) ** 2)

    def _walk(self, hours: float) -> None:
        s, e = self._settings, self._actuation.touch_error
        self.P[FRICTION, FRICTION] += s.friction_drift_per_sqrt_h**2 * hours
        self.P[SHIFT, SHIFT] += (s.touch_drift_per_sqrt_h * e) ** 2 * hours
        bends = (s.shape_drift_per_sqrt_h * self.capacity_nm) ** 2 * hours
        self.P[:NODES, :NODES] += bends * self._prior

    def _double(self) -> None:
        a, left_open = prior.twice_the_span(NODES)
        self.span *= 2.0
        whole = np.eye(STATES)
        whole[:NODES, :NODES] = a
        self.x = whole @ self.x
        self.P = whole @ self.P @ whole.T
        self.P[:NODES, :NODES] += self.capacity_nm**2 * left_open
        self.samples = np.concatenate([self.samples[0:-1:2] + self.samples[1::2], np.zeros(NODES - NODES // 2)])

    def _model(self, x: float, rate: float, slip: float, theta: float) -> tuple[Floats, float, float]:
        """Return the Jacobian ``[STATES]``, the expected torque, and how steep it is, N·m per unit."""
        e = self._actuation.touch_error
        turn = math.tanh(rate / (_FAST_PER_S * e))
        place = x - self.x[SHIFT] - self.x[LAG] * rate - 0.5 * self.x[HYSTERESIS] * turn
        weights, slopes = hat(place, self.left, self.span)
        curve, slope = float(weights @ self.x[:NODES]), float(slopes @ self.x[:NODES])
        log_slip = math.log(slip / SLIP_0_RAD_S)
        friction = 1.0 + self.x[HEAT] * theta + self.x[SLIP] * log_slip
        scale = (1.0 + self.x[GAIN]) * math.exp(self.x[FRICTION]) * friction
        jacobian = np.zeros(STATES)
        jacobian[:NODES] = scale * weights
        jacobian[FRICTION] = scale * curve
        jacobian[GAIN] = scale / (1.0 + self.x[GAIN]) * curve
        jacobian[OFFSET] = 1.0
        jacobian[HEAT] = scale / friction * theta * curve
        jacobian[SLIP] = scale / friction * log_slip * curve
        jacobian[SHIFT] = -scale * slope
        jacobian[LAG] = -scale * slope * rate
        jacobian[HYSTERESIS] = -0.5 * scale * slope * turn
        return jacobian, scale * curve + self.x[OFFSET], scale * slope

    def curve(self, theta: float) -> tuple[Floats, Floats]:
        """Return the capacity at the nodes of the `grid` ``[NODES]`` and its covariance, N·m.

        That of now, at ϑ, slip v_0 and half-way through the hysteresis.
        """
        heat = 1.0 + self.x[HEAT] * theta
        scale = math.exp(self.x[FRICTION]) * heat
        weights, slopes = np.zeros((NODES, NODES)), np.zeros((NODES, NODES))
        for i, place in enumerate((self.grid - self.x[SHIFT]).tolist()):
            weights[i], slopes[i] = hat(place, self.left, self.span)
        curve = weights @ self.x[:NODES]
        rows = np.zeros((NODES, STATES))
        rows[:, :NODES] = scale * weights
        rows[:, FRICTION] = scale * curve
        rows[:, HEAT] = scale / heat * theta * curve
        rows[:, SHIFT] = -scale * (slopes @ self.x[:NODES])
        return scale * curve, rows @ self.P @ rows.T


def hat(place: float, left: float, span: float) -> tuple[Floats, Floats]:
    """Return by which weights ``[NODES]`` a straight piece between two nodes has its value, and its slope."""
    step = span / (NODES - 1)
    position = min(max((place - left) / step, 0.0), NODES - 1.0)
    i = min(int(position), NODES - 2)
    weights, slopes = np.zeros(NODES), np.zeros(NODES)
    weights[i], weights[i + 1] = 1.0 - (position - i), position - i
    slopes[i], slopes[i + 1] = -1.0 / step, 1.0 / step
    return weights, slopes
