"""Physical parameters of a vehicle with a dual clutch transmission. SI units; none has a silent default."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

STANDARD_GRAVITY = 9.80665  # m/s²
AIR_DENSITY = 1.2  # kg/m³
MAX_GEAR = 15  # largest gear number; that of reverse is −1
GEARS = MAX_GEAR + 2  # places of a table by gear number + 1


class DrivenAxle(IntEnum):
    """Which wheels the transmission drives."""

    FRONT = 0
    REAR = 1
    ALL = 2


@dataclass(frozen=True, slots=True)
class Gear:
    """One forward gear (1, 2, …) or reverse (-1)."""

    number: int
    shaft: int  # 1 or 2
    ratio: float  # i_t; negative for reverse
    final_drive: float  # i_f
    inertia_kgm2: float  # J_g, on its input shaft

    @property
    def total_ratio(self) -> float:
        """R = i_t · i_f."""
        return self.ratio * self.final_drive


@dataclass(frozen=True, slots=True)
class Shaft:
    """One input shaft with its transfer shaft."""

    inertia_kgm2: float  # J_c, clutch disc and shaft
    transfer_stiffness_nm_per_rad: float  # k_t
    transfer_damping_nms_per_rad: float  # b_t
    spin_loss_nm: float = 0.0  # bearings, seals and churning gears, against the motion, whatever the load
    spin_loss_nms_per_rad: float = 0.0  # … and how that grows with the speed


@dataclass(frozen=True, slots=True)
class Thermal:
    """One clutch as one heat capacity that its friction warms and the coolant (oil, or air) cools."""

    heat_capacity_j_per_k: float  # C
    cooling_w_per_k: float  # h
    coolant_c: float  # temperature of the coolant, °C


@dataclass(frozen=True, slots=True)
class Clutch:
    """One clutch; its torque *capacity* is ``surfaces * mu * effective_radius_m * normal_force``."""

    effective_radius_m: float
    friction_static: float
    friction_kinetic: float
    surfaces: int
    max_normal_force_n: float
    drag_nms_per_rad: float  # viscous drag of the open clutch
    thermal: Thermal | None = None  # no temperature is estimated without

    @property
    def static_capacity_nm(self) -> float:
        """Largest torque that it holds without slip, N·m."""
        return self.surfaces * self.friction_static * self.effective_radius_m * self.max_normal_force_n


@dataclass(frozen=True, slots=True)
class Damper:
    """Torsional damper between engine and clutch drums."""

    inertia_kgm2: float  # J_d, secondary side
    stiffness_nm_per_rad: float
    damping_nms_per_rad: float


@dataclass(frozen=True, slots=True)
class OutputShaft:
    """Output shaft between final drive and wheels."""

    inertia_kgm2: float  # J_o
    stiffness_nm_per_rad: float  # k_o
    damping_nms_per_rad: float  # b_o
    spin_loss_nm: float = 0.0  # of final drive and differential, at this shaft
    spin_loss_nms_per_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class Chassis:
    """Vehicle body, wheels and road load of equation (11)."""

    mass_kg: float
    wheel_radius_m: float
    wheel_inertia_kgm2: float  # all wheels together, J_w
    rolling_resistance: float  # K_rr
    drag_coefficient: float  # C_d
    frontal_area_m2: float  # A

    @property
    def inertia_kgm2(self) -> float:
        """J_v = m_v r_w² + J_w, at the wheel."""
        return self.mass_kg * self.wheel_radius_m**2 + self.wheel_inertia_kgm2


@dataclass(frozen=True, slots=True)
class Vehicle:
    """All parameters of one vehicle."""

    engine_inertia_kgm2: float
    damper: Damper
    shafts: tuple[Shaft, Shaft]
    clutches: tuple[Clutch, Clutch]
    gears: tuple[Gear, ...]
    gear_efficiency: float  # of the engaged gear pair
    final_drive_efficiency: float
    output_shaft: OutputShaft
    chassis: Chassis

    def gear(self, number: int) -> Gear:
        """Return gear ``number``.

        Raises:
            KeyError: the vehicle has no such gear.
        """
        for gear in self.gears:
            if gear.number == number:
                return gear
        raise KeyError(f"no gear {number}; the vehicle has {[g.number for g in self.gears]}")

    def shaft_inertia_kgm2(self, shaft: int) -> float:
        """Return J_c of input shaft 1 or 2 with all its gears: they turn with it, engaged or not."""
        return self.shafts[shaft - 1].inertia_kgm2 + sum(gear.inertia_kgm2 for gear in self.gears_on(shaft))

    def gears_on(self, shaft: int) -> tuple[Gear, ...]:
        """Return the gears on input shaft 1 or 2, in ascending order of number."""
        return tuple(sorted((g for g in self.gears if g.shaft == shaft), key=lambda g: g.number))
