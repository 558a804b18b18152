"""The `vehicle:` section: physical parameters. Nothing here has a default but in a class of cars."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from dctorque_can.config.problems import KeyPath
from dctorque_can.config.section import Section
from dctorque_can.driveline.parameters import (
    Chassis,
    Clutch,
    Damper,
    DrivenAxle,
    Gear,
    OutputShaft,
    Shaft,
    Thermal,
    Vehicle,
)

REVERSE = -1

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Efficiency = Annotated[float, Field(gt=0, le=1)]
ShaftNumber = Literal[1, 2]


def gear_number(key: Any) -> Any:
    """Return the number of a gear: 1, 2, … as they are, ``R`` as -1."""
    if key in ("R", "r", "reverse"):
        return REVERSE
    if isinstance(key, bool) or not isinstance(key, int) or not 1 <= key <= 15:
        raise ValueError("a gear is 1, 2, … or R for reverse")
    return key


class DamperSection(Section):
    """Torsional damper between engine and clutch drums."""

    inertia_kgm2: Positive
    """Inertia J_d of the secondary side with the clutch drums, kg·m²."""
    stiffness_nm_per_rad: Positive
    """Stiffness k_d, N·m/rad."""
    damping_nms_per_rad: NotNegative
    """Damping b_d, N·m·s/rad."""


class ShaftSection(Section):
    """One input shaft with its transfer shaft."""

    inertia_kgm2: Positive
    """Inertia J_c of clutch disc and input shaft, without gears, kg·m²."""
    transfer_stiffness_nm_per_rad: Positive
    """Stiffness k_t of the transfer shaft, N·m/rad."""
    transfer_damping_nms_per_rad: NotNegative
    """Damping b_t of the transfer shaft, N·m·s/rad."""
    spin_loss_nm: NotNegative = 0.0
    """Loss of the turning shaft and its gears whatever the load (bearings, seals), N·m, with warm oil."""
    spin_loss_nms_per_rad: NotNegative = 0.0
    """How much that grows with the shaft's speed (churning), N·m·s/rad."""


class ThermalSection(Section):
    """One clutch as one heat capacity."""

    heat_capacity_j_per_k: Positive
    """Heat capacity C of what friction warms: discs, plates and the oil between them, J/K."""
    cooling_w_per_k: Positive
    """Heat flow h to the coolant per kelvin above it, W/K."""
    coolant_c: Annotated[float, Field(ge=-60, le=250)]
    """Temperature of the coolant (oil, or the air around a dry clutch), at which the clutch starts, °C."""


class ClutchSection(Section):
    """One clutch. Its torque capacity is surfaces · friction · effective radius · normal force."""

    effective_radius_m: Annotated[float, Field(gt=0, le=1)]
    """Effective friction radius R_c, m."""
    friction_static: Annotated[float, Field(gt=0, le=2)]
    """Static friction coefficient, at least the kinetic one."""
    friction_kinetic: Annotated[float, Field(gt=0, le=2)]
    """Kinetic friction coefficient μ."""
    surfaces: Annotated[int, Field(ge=1, le=40)]
    """Number of friction surfaces: 2 for a dry disc."""
    max_normal_force_n: Positive
    """Largest normal force F_n, N."""
    drag_nms_per_rad: NotNegative
    """Viscous drag of the open clutch, N·m·s/rad; 0 for a dry clutch."""
    thermal: ThermalSection | None = None
    """Thermal data; without them no temperature is estimated."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        if self.friction_static < self.friction_kinetic:
            yield ("friction_static",), f"must be at least friction_kinetic ({self.friction_kinetic:g})"

    def build(self) -> Clutch:
        """Return the clutch as the driveline knows it."""
        thermal = Thermal(**dict(self.thermal)) if self.thermal is not None else None
        return Clutch(**dict(self) | {"thermal": thermal})


class GearSection(Section):
    """One gear pair."""

    shaft: ShaftNumber
    """Input shaft that carries the gear, 1 or 2 (driven by clutch 1 or 2)."""
    ratio: Positive
    """Gear ratio i_t, positive for reverse too."""
    final_drive: Positive
    """Final drive ratio i_f that belongs to this gear."""
    inertia_kgm2: NotNegative
    """Inertia J_g of the gear, seen from its input shaft, kg·m²."""


class OutputShaftSection(Section):
    """Output shaft between final drive and wheels."""

    inertia_kgm2: Positive
    """Inertia J_o, kg·m²."""
    stiffness_nm_per_rad: Positive
    """Stiffness k_o, N·m/rad."""
    damping_nms_per_rad: NotNegative
    """Damping b_o, N·m·s/rad."""
    spin_loss_nm: NotNegative = 0.0
    """Loss of final drive and differential whatever the load, at the output shaft, N·m, with warm oil."""
    spin_loss_nms_per_rad: NotNegative = 0.0
    """How much that grows with the output shaft's speed, N·m·s/rad."""


class ChassisSection(Section):
    """Body, wheels and road load of equation (11)."""

    mass_kg: Positive
    """Mass m_v of the vehicle, kg."""
    wheel_radius_m: Annotated[float, Field(gt=0, le=2)]
    """Rolling radius r_w, m; also turns km/h into rad/s."""
    wheel_inertia_kgm2: NotNegative
    """Inertia J_w of all wheels together, kg·m²."""
    rolling_resistance: Annotated[float, Field(ge=0, le=1)]
    """Rolling resistance coefficient K_rr."""
    drag_coefficient: NotNegative
    """Air drag coefficient C_d."""
    frontal_area_m2: NotNegative
    """Frontal area A, m²."""


def build_gear(number: int, section: GearSection) -> Gear:
    """Return one gear as the driveline knows it: the ratio of reverse is negative."""
    ratio = -section.ratio if number == REVERSE else section.ratio
    return Gear(number, section.shaft, ratio, section.final_drive, section.inertia_kgm2)


class VehicleSection(Section):
    """All physical parameters of one vehicle."""

    engine_inertia_kgm2: Positive
    """Inertia J_e of engine and flywheel (primary side of the damper), kg·m²."""
    damper: DamperSection
    """The torsional damper."""
    shafts: dict[ShaftNumber, ShaftSection]
    """The input shafts 1 and 2."""
    clutches: dict[ShaftNumber, ClutchSection]
    """The clutches 1 and 2."""
    gears: dict[Annotated[int, BeforeValidator(gear_number)], GearSection]
    """The gears 1, 2, … and R."""
    gear_efficiency: Efficiency
    """Efficiency of the engaged gear pair, 0..1."""
    final_drive_efficiency: Efficiency
    """Efficiency of the final drive, 0..1."""
    output_shaft: OutputShaftSection
    """The output shaft."""
    chassis: ChassisSection
    """Body, wheels, road load."""
    driven_axle: Literal["front", "rear", "all"]
    """Axle that the transmission drives: front, rear or all."""

    def contradictions(self) -> Iterator[tuple[KeyPath, str]]:  # noqa: D102
        for name, pair in (("shafts", self.shafts), ("clutches", self.clutches)):
            for number in (1, 2):
                if number not in pair:
                    yield (name, number), "missing: a dual clutch transmission has 1 and 2"

    def build(self) -> Vehicle:
        """Return the parameters as the driveline knows them."""
        return Vehicle(
            engine_inertia_kgm2=self.engine_inertia_kgm2,
            damper=Damper(**dict(self.damper)),
            shafts=(Shaft(**dict(self.shafts[1])), Shaft(**dict(self.shafts[2]))),
            clutches=(self.clutches[1].build(), self.clutches[2].build()),
            gears=tuple(build_gear(number, gear) for number, gear in sorted(self.gears.items())),
            gear_efficiency=self.gear_efficiency,
            final_drive_efficiency=self.final_drive_efficiency,
            output_shaft=OutputShaft(**dict(self.output_shaft)),
            chassis=Chassis(**dict(self.chassis)),
        )

    @property
    def axle(self) -> DrivenAxle:
        """The driven axle as the estimator knows it."""
        return DrivenAxle[self.driven_axle.upper()]
