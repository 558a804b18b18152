"""A recording with what all equations of motion need: rates, and which clutch has the torque of the engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dctorque_can.evidence.moments import STEP_S, Mask, Moments, lasting, smooth
from dctorque_can.evidence.torques import carrier, other_rests
from dctorque_can.pipeline.samples import Quantity

Floats = NDArray[np.float64]
REACH = 3.0
"""Standard deviations that a smoothed value reaches to either side."""


def rate(values: Floats, sigma_s: float) -> Floats:
    """Return the rate of smoothed values ``[n]``, 1/s.

    It is weighed against such values. The derivative of a Gaussian that is cut off (`moments.rate`) is 2 % less,
    and so would be the acceleration that belongs to a torque.
    """
    return np.asarray(np.gradient(smooth(values, sigma_s), STEP_S), np.float64)


@dataclass(frozen=True, slots=True)
class Guess:
    """What equations need that is itself a result: they are set up anew with what was found.

    Attributes:
        engine_inertia_kgm2: J_e + J_d, or J_e alone in front of the damper.
        damper_inertia_kgm2: J_d.
        shaft_inertia_kgm2: of both shafts with their gears ``[2]``.
        spin_loss: N·m and N·m·s/rad of both shafts ``[2][2]``.
        drag: of both clutches while they are open ``[2]``, N·m·s/rad.
        loss: λ, of gear and final drive.
        car_inertia_kgm2: M.
        compliance: of damper and output shaft ``[2]``, rad/(N·m).
        lag_s: of the engine behind its nominal torque.
    """

    engine_inertia_kgm2: float
    damper_inertia_kgm2: float
    shaft_inertia_kgm2: tuple[float, float]
    spin_loss: tuple[tuple[float, float], tuple[float, float]]
    drag: tuple[float, float]
    loss: float
    car_inertia_kgm2: float
    compliance: tuple[float, float]
    lag_s: float = 0.0


@dataclass(frozen=True)
class Drive:
    """A recording with what all equations need.

    Attributes:
        m: the recording at its moments.
        guess: see there.
        has: which clutch alone has the engine's torque ``[n]``: 0, 1; −1 none, −2 not known.
        ratio: R of it ``[n]``; 0 where there is none.
        message: by quantity, how the delay of its message is called.
    """

    m: Moments
    guess: Guess
    has: NDArray[np.int64]
    ratio: Floats
    message: Mapping[Quantity, str]

    @classmethod
    def of(cls, m: Moments, guess: Guess, message: Mapping[Quantity, str]) -> Drive:
        """Return the drive of a recording."""
        has = carrier(m)
        row = np.arange(len(m.t_s))
        ratio = np.where(has >= 0, m.ratio[np.maximum(has, 0), row], 0.0)
        return cls(m, guess, has, ratio, message)

    @property
    def rolls_in_front(self) -> bool:
        """Whether the wheels that tell of the body are the front ones."""
        return self.m.knows_body and not self.m.driven_fronts[0]

    def clutch_torque(self, sigma_s: float) -> Floats:
        """Return the torque behind the clutch that has all of it ``[n]``, N·m, smoothed."""
        m, g = self.m, self.guess
        torque = smooth(m.torque, sigma_s) - g.lag_s * rate(m.torque, sigma_s)
        return torque - g.engine_inertia_kgm2 * rate(m.engine, sigma_s)

    def output_torque(self, sigma_s: float) -> Floats:
        """Return the torque of the output shaft ``[n]``, N·m, smoothed."""
        i = np.maximum(self.has, 0)
        row = np.arange(len(self.m.t_s))
        shaft = np.nan_to_num(self.m.shaft)[i, row]
        spin = np.asarray(self.guess.spin_loss)[i]
        net = self.clutch_torque(sigma_s) - np.asarray(self.guess.shaft_inertia_kgm2)[i] * rate(shaft, sigma_s)
        net -= spin[:, 0] + spin[:, 1] * np.abs(smooth(shaft, sigma_s))
        return self.ratio * (net - self.guess.loss * np.abs(net))

    def steady(self, sigma_s: float) -> Mask:
        """Where one clutch alone has carried in one gear for as long as the smoothing reaches ``[n]``.

        A shaft that is being synchronised takes torque from the wheels, or gives some: it must rest meanwhile.
        """
        state = np.where((self.has >= 0) & (self.ratio > 0.0), self.ratio, 0.0)
        same = np.concatenate([[True], np.diff(state) == 0.0])
        same &= other_rests(self.m, np.maximum(self.has, 0))
        reach = REACH * sigma_s + 0.1
        return lasting(same & (state > 0.0), reach, reach)

    def late(self, quantities: Sequence[Quantity], column: Floats) -> dict[str, Floats]:
        """Return a column ``[n]`` for the delay of each message that quantities come in, which count alike."""
        found: dict[str, Floats] = {}
        for quantity in quantities:
            name = self.message[quantity]
            found[name] = found.get(name, 0.0) + column / len(quantities)
        return found
