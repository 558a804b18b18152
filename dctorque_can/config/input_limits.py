"""What an input can be, and how fast it can change: keys in its own unit, as SI."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dctorque_can.config.inputs import ANY, PLAUSIBLE
from dctorque_can.config.problems import KeyPath
from dctorque_can.config.signals import InputSection
from dctorque_can.config.units import DIMENSIONS, UnitError, factor_to_si
from dctorque_can.pipeline.samples import Quantity


@dataclass(frozen=True, slots=True)
class InputLimits:
    """The limits of one input.

    Attributes:
        path: of its section.
        section: what the vehicle file says.
        quantity: what it measures.
        factors: of each of its signals to SI.
        wheel_radius_m: for speeds of wheels in km/h.
        complain: is told what is wrong.
    """

    path: KeyPath
    section: InputSection
    quantity: Quantity
    factors: Sequence[float]
    wheel_radius_m: float
    complain: Callable[[KeyPath, str], None]

    def range(self) -> tuple[float, float]:
        """Return the lowest and the highest plausible value, SI."""
        given = self.section.range
        if given is None or given[0] >= given[1]:
            return PLAUSIBLE.get(self.quantity, ANY)
        factor = self._factor("range")
        return ANY if factor is None else (given[0] * factor, given[1] * factor)

    def most_per_s(self) -> float:
        """Return how much it may change in a second, SI."""
        if self.section.max_rate is None:
            return math.inf
        factor = self._factor("max_rate")
        return math.inf if factor is None else self.section.max_rate * abs(factor)

    def _factor(self, key: str) -> float | None:
        """Return the factor to SI of a key in the unit of the input; None where it is not clear which that is."""
        factor = self.factors[0]
        if all(other == factor for other in self.factors):
            return factor
        if self.section.unit is None:
            self.complain(
                (*self.path, key), f"the signals have different units: give the unit of the {key} as unit:"
            )
            return None
        try:
            return factor_to_si(
                self.section.unit,
                DIMENSIONS[self.quantity],
                wheel_radius_m=self.wheel_radius_m,
                reference_nm=self.section.reference_nm,
            )
        except UnitError as error:
            self.complain((*self.path, "unit"), str(error))
            return factor
