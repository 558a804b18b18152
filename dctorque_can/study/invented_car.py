"""Cars that nobody has: physics drawn around a class of cars, on a bus that is drawn too.

Their vehicle files are true. Who tests a tool on them leaves out or bends what the tool is to find.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from dctorque_can.config.document import parse
from dctorque_can.config.vehicle_class import SHARES
from dctorque_can.resources import shipped_class, shipped_classes
from dctorque_can.study.invented_bus import Coding, InventedBus

_DIRECTIONS = ("forward", "backward", "standstill", "unknown")
_TELLS_SHARE = 0.75  # of cars, for each of the inputs that some tell
_RATIO_SHARE = 0.04  # of each gear, around that of the class
_MOST_LATE_MS = {"ECM": 10.0, "TCU": 10.0, "ESC": 30.0}
_SPEEDS = tuple(
    Coding(bits, factor, 0.0, "rpm") for bits, factor in ((16, 0.25), (16, 0.125), (14, 0.5), (13, 1.0))
)
_WHEELS = (
    Coding(15, 0.01, 0.0, "km/h"),
    Coding(14, 0.03125, 0.0, "km/h"),
    Coding(13, 0.05625, 0.0, "km/h"),
    Coding(16, 0.02, 0.0, "rad/s", signed=True),
    Coding(16, 0.01, 0.0, "km/h", signed=True),
    Coding(14, 0.01, 0.0, "m/s"),
)
_ACCELERATIONS = (
    Coding(12, 0.01, -20.48, "m/s2"),
    Coding(10, 0.05, -25.6, "m/s2"),
    Coding(12, 0.001, -2.048, "g"),
)
_GRADES = (Coding(10, 0.1, -51.2, "%"), Coding(8, 0.5, -64.0, "%"), Coding(10, 0.05, -25.6, "deg"))
_POSITIONS = (("mm", 0.01, 12.0), ("%", 0.05, 100.0), ("bar", 0.01, 12.0))  # unit, factor, fully closed


@dataclass(frozen=True, slots=True)
class InventedCar:
    """One car.

    Attributes:
        class_name: class of cars around which it was drawn.
        vehicle_file: all sections of its vehicle file, true.
        dbc: its DBC, ``car.dbc`` in the vehicle file.
    """

    class_name: str
    vehicle_file: dict[str, Any]
    dbc: bytes

    @property
    def documents(self) -> dict[str, bytes]:
        """Its files by name, for `config.load.load_documents`."""
        text = yaml.safe_dump(self.vehicle_file, sort_keys=False, allow_unicode=True, width=110)
        return {"car.yaml": text.encode(), "car.dbc": self.dbc}

    @property
    def owners_file(self) -> dict[str, Any]:
        """What its owner knows: how the bus is read, but no delay; the ratios; of all else the class."""
        vehicle = self.vehicle_file["vehicle"]
        gears = {
            number: {key: gear[key] for key in ("shaft", "ratio", "final_drive")}
            for number, gear in vehicle["gears"].items()
        }
        known: dict[str, Any] = _without_delays(self.vehicle_file)
        known["vehicle"] = {"class": self.class_name, "gears": gears, "driven_axle": vehicle["driven_axle"]}
        return known


def _without_delays(value: Any) -> Any:
    """Return a part of a vehicle file without its delays."""
    if isinstance(value, dict):
        return {key: _without_delays(item) for key, item in value.items() if key != "delay_ms"}
    return [_without_delays(item) for item in value] if isinstance(value, list) else value


def invent_car(seed: int, class_name: str | None = None, tells_motion: bool = False) -> InventedCar:
    """Return the car of a seed.

    Args:
        seed: draws all.
        class_name: class of cars; None draws it too.
        tells_motion: whether its bus may also tell acceleration, grade and direction; all else is the same.

    Raises:
        DctorqueError: there is no such class.
    """
    random = np.random.default_rng([seed, 0xCA7])
    names = [path.stem for path in shipped_classes()]
    drawn = names[int(random.integers(len(names)))]
    name = class_name or drawn
    vehicle = parse(shipped_class(name).read_bytes(), name).data["vehicle"]
    _vary(vehicle, random)
    _vary_gears(vehicle["gears"], random)
    for clutch in vehicle["clutches"].values():
        clutch["friction_static"] = max(clutch["friction_static"], clutch["friction_kinetic"])
    bus = InventedBus(random)
    reading = _Reading(bus, random, vehicle)
    sections = reading.sections()
    if tells_motion:
        sections["inputs"] |= reading.motion()
    file = {"name": f"invented car {seed}", "vehicle": vehicle, "databases": [{"file": "car.dbc"}], **sections}
    protections = bus.protections()
    if protections:
        file["protection"] = protections
    return InventedCar(name, file, bus.dbc())


def _vary(part: dict[Any, Any], random: np.random.Generator) -> None:
    """Draw each number anew, evenly within one standard deviation of the class."""
    for key, value in part.items():
        if isinstance(value, dict):
            if key != "gears":
                _vary(value, random)
        elif key in SHARES:
            drawn = value * (1.0 + SHARES[key] * random.uniform(-1.0, 1.0))
            part[key] = float(f"{min(drawn, 0.995) if key.endswith('efficiency') else drawn:.4g}")


def _vary_gears(gears: dict[Any, dict[str, Any]], random: np.random.Generator) -> None:
    finals = sorted({gear["final_drive"] for gear in gears.values()})
    factors = {final: 1.0 + _RATIO_SHARE * random.uniform(-1.0, 1.0) for final in finals}
    for gear in gears.values():
        gear["inertia_kgm2"] = float(f"{gear['inertia_kgm2'] * (1.0 + 0.3 * random.uniform(-1.0, 1.0)):.4g}")
        gear["ratio"] = round(gear["ratio"] * (1.0 + 0.3 * _RATIO_SHARE * random.uniform(-1.0, 1.0)), 3)
        gear["final_drive"] = round(gear["final_drive"] * factors[gear["final_drive"]], 3)


class _Reading:
    """The sections of a vehicle file that read a bus, drawn together with its signals."""

    def __init__(self, bus: InventedBus, random: np.random.Generator, vehicle: Mapping[str, Any]) -> None:
        self._bus, self._random = bus, random
        self._gears = {number: gear["shaft"] for number, gear in vehicle["gears"].items()}
        self._late_ms = {unit: round(float(random.uniform(0.0, most)), 1) for unit, most in _MOST_LATE_MS.items()}

    def sections(self) -> dict[str, Any]:
        """Return ``inputs``, ``gears`` and ``clutch_phase``."""
        inputs: dict[str, Any] = {"engine_speed": self._engine_speed(), "engine_torque": self._engine_torque()}
        shafts = self._one_of(_SPEEDS)
        inputs |= {name: self._speed("TCU", name, shafts) for name in ("shaft1_speed", "shaft2_speed")}
        wheels = self._one_of(_WHEELS)
        inputs["wheel_speeds"] = {
            name: self._speed("ESC", name, wheels, timeout_ms=200) for name in ("fl", "fr", "rl", "rr")
        }
        if self._random.random() < 0.8:
            inputs["brake"] = {"signal": self._bus.add("ESC", "brake", self._brake()), "timeout_ms": 200}
        return {"inputs": inputs, "gears": self._gear_section(), "clutch_phase": self._clutches()}

    def motion(self) -> dict[str, Any]:
        """Return the inputs acceleration, grade and direction, each of which most cars tell."""
        inputs: dict[str, Any] = {}
        late = {"timeout_ms": 200, **self._late("ESC")}
        for name, codings in (("acceleration", _ACCELERATIONS), ("grade", _GRADES)):
            if self._random.random() < _TELLS_SHARE:
                inputs[name] = {"signal": self._bus.add("ESC", name, self._one_of(codings)), **late}
        if self._random.random() < _TELLS_SHARE:
            values = dict(enumerate(self._random.permutation(_DIRECTIONS).tolist()))
            signal = self._bus.add("ESC", "direction", Coding(2, 1))
            inputs["direction"] = {"signal": signal, "values": values, "measured": True, **late}
        return inputs

    def _one_of(self, choices: Any) -> Any:
        return choices[int(self._random.integers(len(choices)))]

    def _late(self, unit: str) -> dict[str, float]:
        return {"delay_ms": self._late_ms[unit]}

    def _brake(self) -> Coding:
        coding: Coding = self._one_of((Coding(1, 1), Coding(10, 0.2, 0.0, "bar")))
        return coding

    def _speed(self, unit: str, what: str, coding: Coding, timeout_ms: int = 100) -> dict[str, Any]:
        signal = self._bus.add(unit, what, coding)
        return {"signal": signal, "signed": coding.signed, "timeout_ms": timeout_ms, **self._late(unit)}

    def _engine_speed(self) -> dict[str, Any]:
        signal = self._bus.add("ECM", "engine_speed", self._one_of(_SPEEDS))
        return {"signal": signal, **self._late("ECM")}

    def _engine_torque(self) -> dict[str, Any]:
        kind = self._one_of(("nm", "nm", "share", "parts"))
        if kind == "nm":
            coding = self._one_of((Coding(12, 0.5, -500.0, "Nm"), Coding(11, 1.0, -500.0, "Nm")))
            return {"signal": self._bus.add("ECM", "engine_torque", coding), **self._late("ECM")}
        if kind == "share":
            signal = self._bus.add("ECM", "engine_torque", Coding(12, 0.1, -100.0, "%"))
            reference = self._bus.add("ECM", "torque_reference", Coding(12, 1.0, 0.0, "Nm"), cycle_ms=1000)
            return {"signal": signal, "times": {"signal": reference}, **self._late("ECM")}
        indicated = self._bus.add("ECM", "torque_indicated", Coding(12, 0.5, -500.0, "Nm"))
        friction = self._bus.add("ECM", "torque_friction", Coding(9, 0.5, 0.0, "Nm"))
        terms = [{"signal": indicated}, {"signal": friction, "factor": -1}]
        return {"sum": terms, **self._late("ECM")}

    def _codes(self, gears: list[Any]) -> dict[int, Any]:
        """Return raw values of gears: as they are numbered, or not."""
        neutral, first = self._one_of(((0, 1), (15, 1), (1, 2), (0, 5)))
        codes: dict[int, Any] = {neutral: "neutral"}
        codes |= {first + gear - 1: gear for gear in gears if gear != "R"}
        if "R" in gears:
            codes[next(raw for raw in (14, 13, 7) if raw not in codes)] = "reverse"
        return codes

    def _gear_section(self) -> dict[str, Any]:
        coding = Coding(4, 1)
        if self._random.random() < 0.5:
            section: dict[str, Any] = {"source": "signals"}
            for shaft in (1, 2):
                codes = self._codes([number for number, on in self._gears.items() if on == shaft])
                signal = self._bus.add("TCU", f"gear{shaft}", coding)
                section[f"shaft{shaft}"] = {"signal": signal, "values": codes, "timeout_ms": 100}
            return section
        codes = self._codes(list(self._gears))
        section = {
            "source": "gearbox",
            "actual": {"signal": self._bus.add("TCU", "gear", coding), "values": codes, "timeout_ms": 100},
        }
        if self._random.random() < 0.7:
            signal = self._bus.add("TCU", "target_gear", coding)
            section["target"] = {"signal": signal, "values": codes, "timeout_ms": 100}
        return section

    def _clutches(self) -> dict[str, Any]:
        kind = self._one_of(("position", "position", "position", "command"))
        if kind == "command":
            coding = Coding(12, 0.5, -100.0, "Nm")
            return {"source": "command"} | {
                name: {
                    "signal": self._bus.add("TCU", name, coding),
                    "threshold_nm": 3,
                    "hysteresis_nm": 2,
                    **self._late("TCU"),
                }
                for name in ("clutch1", "clutch2")
            }
        unit, factor, closed = self._one_of(_POSITIONS)
        increasing = unit == "bar" or bool(self._random.integers(2))
        section: dict[str, Any] = {"source": "position"}
        for name in ("clutch1", "clutch2"):
            share = float(self._random.uniform(0.2, 0.45))
            point = round(closed * (share if increasing else 1.0 - share), 2)
            section[name] = {
                "signal": self._bus.add("TCU", name, Coding(12, factor, 0.0, unit, most=closed)),
                "range": [-0.1 * closed, 1.1 * closed],
                "kissing_point": point,
                "hysteresis": round(0.02 * closed, 3),
                "closes": "increasing" if increasing else "decreasing",
                **self._late("TCU"),
            }
        return section
