"""What goes wrong with clutches and gears of a simulated car on a drive; its control is not told either."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.simulation.knots import Knots, sampled
from dctorque_can.simulation.powertrain import Powertrain

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Faults:
    """Faults of a car on one drive; as it is made, it has none.

    Attributes:
        judder: by what share the capacity of both clutches swings, as that of plates that run out of true does.
        judder_hz: its frequency at the beginning and at the end of the drive.
        fading: share of its friction that a clutch has lost once it stores `Powertrain.clutch_fading_heat_j`.
        kissing_point_mm: by how much the kissing point of clutch 1 has moved; negative: it touches earlier. The
            gearbox control has not learned it.
        friction: of the friction of both clutches, what time has left of it.
        overlap_nm: capacity that both clutches are given at least while a shift hands over and synchronises.
        synchroniser_nm: torque of every cone on its input shaft, however little it has to do; 0: as it needs.
    """

    judder: float = 0.0
    judder_hz: tuple[float, float] = (10.0, 10.0)
    fading: float = 0.0
    kissing_point_mm: Knots = ((0.0, 0.0),)
    friction: Knots = ((0.0, 1.0),)
    overlap_nm: Knots = ((0.0, 0.0),)
    synchroniser_nm: float = 0.0

    def of(self, powertrain: Powertrain) -> Powertrain:
        """Return a powertrain with the faults that last."""
        if self.fading > 0.0:
            powertrain = replace(powertrain, clutch_fading=self.fading)
        if self.synchroniser_nm > 0.0:
            lever = powertrain.synchroniser_friction_kinetic * powertrain.synchroniser_lever_m
            force = self.synchroniser_nm / lever
            powertrain = replace(powertrain, synchroniser_max_force_n=force, synchroniser_time_s=_AT_ONCE_S)
        return powertrain

    def over(self, t: Floats, right: Floats) -> Disturbances:
        """Return what happens at the times ``t`` ``[n]`` in s, beside the friction of the right driven tyre."""
        factor = np.ones((len(t), 2)) * sampled(self.friction, t)[:, None]
        if self.judder > 0.0:
            first, last = self.judder_hz
            turns = first * t + 0.5 * (last - first) * t**2 / max(t[-1], 1e-3)
            factor *= 1.0 + self.judder * np.sin(2.0 * pi * turns)[:, None]
        shift = np.zeros((len(t), 2))
        shift[:, 0] = sampled(self.kissing_point_mm, t)
        return Disturbances(factor, shift, sampled(self.overlap_nm, t), right)


NO_FAULTS = Faults()


class Disturbances(NamedTuple):
    """Faults by the millisecond, as the compiled plant reads them.

    Attributes:
        factor: ``[n, 2]`` of the capacity of each clutch, at the end of the millisecond.
        kiss_shift: ``[n, 2]`` mm.
        overlap: ``[n]`` N·m, see `Faults`.
        right: ``[n]`` friction of the right driven tyre; only read where there are two.
    """

    factor: Floats
    kiss_shift: Floats
    overlap: Floats
    right: Floats


_AT_ONCE_S = 1e-3  # no cone is asked for less than its greatest torque then
