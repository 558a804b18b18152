"""Signals of invented cars, in several styles, with what is mistaken for them."""

from __future__ import annotations

import numpy as np

from .bus import KM_H, RPM, Drive, Floats, Signal


def speed(name: str, of: str, **more: object) -> Signal:
    """A rotation in rpm."""
    return Signal(name, lambda d: RPM * getattr(d, of), 16, 0.25, 0.0, **({"unit": "rpm"} | more))  # type: ignore[arg-type]


def wheels(message: str, names: tuple[str, str, str, str], unit: str = "km/h") -> list[Signal]:
    """Wheel speeds fl, fr, rl, rr of a car with front-wheel drive."""

    def driven(sign: float) -> object:
        return lambda d: KM_H * np.abs(d.wheel_speed_rad_s + sign * d.wheel_difference_rad_s)

    carried = [driven(1.0), driven(-1.0), lambda d: KM_H * d.wheel, lambda d: KM_H * d.wheel]
    return [
        Signal(f"{message}.{name}", each, 16, 0.01, 0.0, unit)  # type: ignore[arg-type]
        for name, each in zip(names, carried, strict=True)
    ]


def wanted(drive: Drive) -> Floats:
    """What the driver asks for: the engine's torque as it will be, less smooth."""
    return drive.later(drive.engine_torque_nominal_nm, -0.15) * 1.06 + 4.0


ENGLISH = [
    speed("EngineData.EngSpd", "engine_speed_rad_s"),
    Signal("EngineData.EngTrqAct", lambda d: d.engine_torque_nominal_nm, 12, 0.5, -500.0, "Nm"),
    Signal("EngineData.BrkPdlPressed", lambda d: (d.brake_n > 0) * 1.0, 1),
    speed("Gearbox.InpShaft1Spd", "shaft1_speed_rad_s"),
    speed("Gearbox.InpShaft2Spd", "shaft2_speed_rad_s"),
    Signal("Gearbox.GearAct", lambda d: d.gear, 4),
    *wheels("Brakes", ("WhlSpdFL", "WhlSpdFR", "WhlSpdRL", "WhlSpdRR")),
    Signal("Brakes.LongAccel", lambda d: d.acceleration + 9.81 * d.grade_rad, 12, 0.02, -40.0, "m/s^2"),
]
"""What is to be found."""
RIVALS = [
    speed("EngineData2.EngSpdTgt", "damper_speed_rad_s"),
    Signal("EngineData2.EngSpdFilt", lambda d: RPM * d.later(d.engine_speed_rad_s, 0.08), 16, 0.25, 0.0, "rpm"),
    Signal("EngineData2.EngIdleSpdSetp", lambda d: 750.0 + 100.0 * (d.t_us < 6e7), 16, 0.25, 0.0, "rpm"),
    Signal(
        "EngineData2.EngSpdDisp", lambda d: 25 * np.round(RPM * d.engine_speed_rad_s / 25), 16, 0.25, 0.0, "rpm"
    ),
    Signal("EngineData2.EngSpdMax", lambda d: 6500.0 - 500.0 * (d.t_us < 3e7), 16, 0.25, 0.0, "rpm"),
    Signal(
        "EngineData2.EngSpdGrad",
        lambda d: 3e3 + np.gradient(RPM * d.engine_speed_rad_s, 1e-3),
        16,
        1.0,
        0.0,
        "rpm",
    ),
    Signal("EngineData2.EngTrqReq", wanted, 12, 0.5, -500.0, "Nm"),
    Signal("EngineData2.DrvrDmdTrq", wanted, 12, 0.5, -500.0, "Nm"),
    Signal("EngineData2.EngTrqMax", lambda d: 250.0 + 0.2 * d.engine_speed_rad_s, 12, 0.5, -500.0, "Nm"),
    Signal("EngineData2.EngTrqFilt", lambda d: d.later(d.engine_torque_nominal_nm, 0.2), 12, 0.5, -500.0, "Nm"),
    Signal("EngineData2.EngTrqFric", lambda d: 15.0 + 0.03 * d.engine_speed_rad_s, 12, 0.5, -500.0, "Nm"),
    speed("Gearbox2.OutpShaftSpd", "output_speed_rad_s"),
    Signal("Gearbox2.GearLvrPos", lambda d: 3.0 - 2.0 * (d.t_us < 3e6), 4),
    Signal("Gearbox2.GearTgt", lambda d: d.later(d.gear, -0.4), 4),
    Signal("Gearbox2.GearRecommend", lambda d: np.clip(d.gear + (d.gear < 5), 1, 7), 4),
    Signal("Brakes2.VehSpd", lambda d: KM_H * d.wheel, 16, 0.01, 0.0, "km/h"),
    Signal("Brakes2.WhlSpdAvg", lambda d: KM_H * d.wheel, 16, 0.01, 0.0, "km/h"),
    Signal("Brakes2.AccelReq", lambda d: d.later(d.acceleration, -0.3), 12, 0.02, -40.0, "m/s^2"),
    Signal("Brakes2.LatAccel", lambda d: 2.0 * np.sin(1e-6 * d.t_us), 12, 0.02, -40.0, "m/s^2"),
    Signal("Brakes2.SteerTrq", lambda d: 3.0 * np.sin(1e-6 * d.t_us), 12, 0.01, -20.0, "Nm"),
    Signal("Brakes2.BrkTrqReq", lambda d: d.brake_n * 0.31, 14, 1.0, 0.0, "Nm"),
    Signal("Brakes2.ParkBrkAct", lambda d: (d.wheel < 0.1) * 1.0, 1),
]
"""What is mistaken for it: set points, filtered and shown values, limits, rates, demands, other shafts, levers."""
_GEARS = "".join(f'{gear} "Gang {gear}" ' for gear in range(1, 8)) + '0 "kein Gang" 8 "Rückwärtsgang" 15 "Fehler"'
GERMAN = [
    speed("Motor_1.Motordrehzahl", "engine_speed_rad_s", unit="1/min"),
    Signal(
        "Motor_1.IndiziertesIstmoment",
        lambda d: d.engine_torque_nominal_nm + 12.0 + 0.03 * d.engine_speed_rad_s,
        12,
        0.25,
        -200.0,
        "Nm",
    ),
    Signal("Motor_1.Verlustmoment", lambda d: 12.0 + 0.03 * d.engine_speed_rad_s, 12, 0.25, 0.0, "Nm"),
    Signal("Motor_1.Wunschmoment", wanted, 12, 0.25, -200.0, "Nm"),
    Signal("Motor_1.Leerlaufsolldrehzahl", lambda d: 750.0 + 50.0 * (d.t_us < 6e7), 16, 0.25, 0.0, "1/min"),
    Signal("Motor_1.Bremse_betaetigt", lambda d: (d.brake_n > 0) * 1.0, 1),
    speed("Getriebe_1.Eingangsdrehzahl_1", "shaft1_speed_rad_s", unit="1/min"),
    speed("Getriebe_1.Eingangsdrehzahl_2", "shaft2_speed_rad_s", unit="1/min"),
    Signal(
        "Getriebe_1.Istgang",
        lambda d: d.gear,
        4,
        table=_GEARS,
    ),
    Signal(
        "Getriebe_1.Zielgang",
        lambda d: d.later(d.gear, -0.4),
        4,
        table=_GEARS,
    ),
    Signal("Getriebe_1.Kupplung1_Position", lambda d: d.clutch1_position_mm, 12, 0.01, 0.0, "mm"),
    Signal("Getriebe_1.Kupplung2_Position", lambda d: d.clutch2_position_mm, 12, 0.01, 0.0, "mm"),
    *wheels("Bremse_1", ("Radgeschw_VL", "Radgeschw_VR", "Radgeschw_HL", "Radgeschw_HR")),
]
NAMELESS = [
    Signal(f"M{n // 4}.S{n}", each.values, each.bits, each.factor, each.offset)
    for n, each in enumerate([*ENGLISH, *RIVALS[:6]])
]
"""The English car, without names and units."""
