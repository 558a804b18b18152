"""The two engaged gears: ratios, the inertias behind them, and which pairs are singular.

With a total ratio R = i_t i_f for each shaft, equations (27), (28), (65) and (66) divide by R_1 − R_2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.driveline.parameters import Gear, Vehicle
from dctorque_can.errors import DctorqueError

SMALLEST_RATIO_STEP = 1e-3  # relative; closer total ratios of two shafts make (27), (28), (65), (66) singular


@compiled_without_allocation
def effective_inertia(J_own: float, J_other: float, ratio: float) -> float:
    """Return the inertia seen from one clutch, kg·m² (section 4.1).

    J_e1 = J_1 + J_2 (R_2/R_1)²; the paper has i_t2/i_t1, which is the same with one final drive. Kinetic energy
    gives it: rigid shafts turn at ω_c2 = (R_2/R_1) ω_c1.

    Args:
        J_own: inertia of this clutch's shaft, kg·m².
        J_other: inertia of the other shaft, kg·m².
        ratio: speed of the other shaft over the speed of this one, R_other/R_own.
    """
    return J_own + J_other * ratio**2


def singular_pairs(vehicle: Vehicle) -> Iterator[str]:
    """Yield one sentence for each two gears on different shafts whose total ratios are (nearly) the same."""
    for one, two in product(vehicle.gears_on(1), vehicle.gears_on(2)):
        yield from _singularity(one, two)


def _singularity(one: Gear, two: Gear) -> Iterator[str]:
    larger = max(abs(one.total_ratio), abs(two.total_ratio))
    if abs(one.total_ratio - two.total_ratio) < SMALLEST_RATIO_STEP * larger:
        yield (
            f"gears {one.number} and {two.number} have the same total ratio {one.total_ratio:g}: "
            "with both engaged the two clutch torques cannot be told apart "
            f"(ratio · final drive must differ by {100 * SMALLEST_RATIO_STEP:g} % or more)"
        )


@dataclass(frozen=True, slots=True)
class GearPair:
    """One engaged gear on each input shaft. A shaft in neutral has no ratio, and so no place here.

    Attributes:
        gear1: gear on shaft 1.
        gear2: gear on shaft 2.
        J_1, J_2: own inertia of shaft 1 and 2, all that turns with its clutch disc, kg·m².
        i_t1, i_t2: gear ratios.
        i_f1, i_f2: final drive ratios behind them.
        R_1, R_2: total ratios i_t · i_f.
        J_e1, J_e2: effective inertia of both rigid shafts seen from clutch 1 and 2, kg·m² (section 4.1).

    Raises:
        DctorqueError: a gear is on the other shaft, or the total ratios are (nearly) equal: the pair is singular.
    """

    gear1: Gear
    gear2: Gear
    J_1: float
    J_2: float
    i_t1: float = field(init=False)
    i_t2: float = field(init=False)
    i_f1: float = field(init=False)
    i_f2: float = field(init=False)
    R_1: float = field(init=False)
    R_2: float = field(init=False)
    J_e1: float = field(init=False)
    J_e2: float = field(init=False)

    def __post_init__(self) -> None:
        wrong = [
            f"gear {gear.number} is on shaft {gear.shaft}, not on shaft {shaft}"
            for shaft, gear in ((1, self.gear1), (2, self.gear2))
            if gear.shaft != shaft
        ]
        wrong += _singularity(self.gear1, self.gear2)
        if wrong:
            raise DctorqueError("vehicle: " + "; ".join(wrong))
        one, two = self.gear1, self.gear2
        R_1, R_2 = one.total_ratio, two.total_ratio
        follows = {
            "i_t1": one.ratio,
            "i_t2": two.ratio,
            "i_f1": one.final_drive,
            "i_f2": two.final_drive,
            "R_1": R_1,
            "R_2": R_2,
            "J_e1": effective_inertia(self.J_1, self.J_2, R_2 / R_1),
            "J_e2": effective_inertia(self.J_2, self.J_1, R_1 / R_2),
        }
        for name, value in follows.items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, vehicle: Vehicle, gear1: int, gear2: int, *, all_gears_turn: bool = False) -> GearPair:
        """Return the pair of gear ``gear1`` on shaft 1 and ``gear2`` on shaft 2.

        Args:
            vehicle: both gears are taken from it.
            gear1: number of the gear on shaft 1.
            gear2: number of the gear on shaft 2.
            all_gears_turn: what turns with a clutch disc besides its shaft. False: the engaged gear alone,
                J_1 = J_c1 + J_g1, as the paper has it and the observer takes it. True: every gear of the shaft, as
                in the reference plant (`simulation`), where they turn whether engaged or not.

        Raises:
            DctorqueError: the vehicle has no such gear, it is on the other shaft, or the pair is singular.
        """
        try:
            one, two = vehicle.gear(gear1), vehicle.gear(gear2)
        except KeyError as error:
            raise DctorqueError(f"vehicle: {error.args[0]}") from None
        if all_gears_turn:
            return cls(one, two, vehicle.shaft_inertia_kgm2(1), vehicle.shaft_inertia_kgm2(2))
        J_c1, J_c2 = (shaft.inertia_kgm2 for shaft in vehicle.shafts)
        return cls(one, two, J_c1 + one.inertia_kgm2, J_c2 + two.inertia_kgm2)
