"""A bus that nobody has: names, scalings, messages, cycles and protections are drawn, as cars differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

_BYTES = 8
_PROTECTED_BITS = 16  # checksum in the first byte, counter in the second one
_CYCLES_MS = {"ECM": (10, 10, 20), "TCU": (10, 10, 20), "ESC": (10, 20, 20)}
_STYLES = ("{unit}_{n}", "{unit}{n:02d}", "Msg_{unit}_{n}", "{unit}_Data{n}")
_NAMES = {
    "engine_speed": ("N_ENG", "nMot", "EngSpd", "RPM"),
    "engine_torque": ("TQ_ACT", "MdMot", "EngTrq", "TRQ_EFF"),
    "torque_indicated": ("TQ_IND", "MdInd", "EngTrqInd", "TRQ_IND"),
    "torque_friction": ("TQ_FR", "MdReib", "EngTrqFric", "TRQ_FRIC"),
    "torque_reference": ("TQ_REF", "MdNorm", "EngTrqRef", "TRQ_MAX"),
    "shaft1_speed": ("N_IN1", "nGe1", "InShft1Spd", "ISS_ODD"),
    "shaft2_speed": ("N_IN2", "nGe2", "InShft2Spd", "ISS_EVEN"),
    "fl": ("V_FL", "vRadVL", "WhlSpdFL", "WS_LF"),
    "fr": ("V_FR", "vRadVR", "WhlSpdFR", "WS_RF"),
    "rl": ("V_RL", "vRadHL", "WhlSpdRL", "WS_LR"),
    "rr": ("V_RR", "vRadHR", "WhlSpdRR", "WS_RR"),
    "brake": ("BRK", "Bremse", "BrkAct", "BRAKE_SW"),
    "acceleration": ("LONG_ACC", "aLaengs", "VehAccLgt", "ACC_X"),
    "grade": ("SLOPE", "Steigung", "RoadGrade", "INCL"),
    "direction": ("DIR", "Richtung", "VehDir", "ROLL_DIR"),
    "gear": ("GEAR", "Gang", "GearAct", "GR_CUR"),
    "target_gear": ("GEAR_TGT", "GangZiel", "GearTgt", "GR_TGT"),
    "gear1": ("GEAR_1", "GangTg1", "GearSh1", "GR_ODD"),
    "gear2": ("GEAR_2", "GangTg2", "GearSh2", "GR_EVEN"),
    "clutch1": ("CL1", "Kup1", "Cltch1", "C1"),
    "clutch2": ("CL2", "Kup2", "Cltch2", "C2"),
}


@dataclass(frozen=True, slots=True)
class Coding:
    """How a value is sent: unit and scale.

    Attributes:
        bits: of the raw value.
        factor: physical value of one bit.
        offset: physical value of raw 0.
        unit: of the physical value.
        signed: whether the raw value is.
        most: largest physical value that comes; None: what the bits can hold.
    """

    bits: int
    factor: float
    offset: float = 0.0
    unit: str = ""
    signed: bool = False
    most: float | None = None

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest physical value."""
        low = -(1 << (self.bits - 1)) if self.signed else 0
        high = (low + (1 << self.bits) - 1) * self.factor + self.offset
        return low * self.factor + self.offset, high if self.most is None else self.most


@dataclass
class _Message:
    name: str
    frame_id: int
    cycle_ms: int
    data_id: int | None
    signals: list[tuple[str, Coding]] = field(default_factory=list)

    @property
    def bits(self) -> int:
        """Bits that are taken."""
        taken = _PROTECTED_BITS if self.data_id is not None else 0
        return taken + sum(coding.bits for _, coding in self.signals)


class InventedBus:
    """Messages that grow by one signal after the other.

    Args:
        random: draws everything.
    """

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        self._style = _STYLES[int(random.integers(len(_STYLES)))]
        self._language = int(random.integers(len(_NAMES["gear"])))
        self._little = bool(random.integers(2))
        self._protected_share = float(random.uniform(0.0, 1.0))
        self._next_id = int(random.integers(0x80, 0x180))
        self._messages: dict[str, list[_Message]] = {}

    def add(self, unit: str, what: str, coding: Coding, *, cycle_ms: int | None = None) -> str:
        """Put a signal into the last message of a control unit that has room for it.

        Args:
            unit: ECM, TCU or ESC.
            what: is sent, a key of the names.
            coding: of the value.
            cycle_ms: of a message of its own; None: any.

        Returns:
            Its name as in a vehicle file, ``Message.Signal``.
        """
        own = self._messages.setdefault(unit, [])
        full = not own or own[-1].bits + coding.bits > 8 * _BYTES or own[-1].cycle_ms == 1000
        if full or cycle_ms is not None:
            own.append(self._new_message(unit, len(own) + 1, cycle_ms))
        name = _NAMES[what][self._language]
        own[-1].signals.append((name, coding))
        return f"{own[-1].name}.{name}"

    def _new_message(self, unit: str, n: int, cycle_ms: int | None) -> _Message:
        self._next_id += int(self._random.integers(1, 12))
        choices: Sequence[int] = _CYCLES_MS[unit]
        drawn = int(choices[int(self._random.integers(len(choices)))])
        protected = self._random.random() < self._protected_share
        data_id = int(self._random.integers(1, 0xFFFF)) if protected else None
        return _Message(self._style.format(unit=unit, n=n), self._next_id, cycle_ms or drawn, data_id)

    def protections(self) -> dict[str, dict[str, object]]:
        """Return the section ``protection`` of the vehicle file."""
        return {
            message.name: {
                "crc": "e2e_p01",
                "crc_signal": f"CRC_{message.name}",
                "counter_signal": f"CNT_{message.name}",
                "data_id": message.data_id,
            }
            for messages in self._messages.values()
            for message in messages
            if message.data_id is not None
        }

    def dbc(self) -> bytes:
        """Return the DBC."""
        messages = [message for own in self._messages.values() for message in own]
        lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", f"BU_: {' '.join(self._messages)}", ""]
        for unit, own in self._messages.items():
            for message in own:
                lines += [f"BO_ {message.frame_id} {message.name}: {_BYTES} {unit}", *self._lines(message), ""]
        lines += ['BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;', 'BA_DEF_DEF_ "GenMsgCycleTime" 0;']
        lines += [f'BA_ "GenMsgCycleTime" BO_ {each.frame_id} {each.cycle_ms};' for each in messages]
        return ("\n".join(lines) + "\n").encode()

    def _lines(self, message: _Message) -> list[str]:
        start, lines = 0, []
        if message.data_id is not None:
            lines = [
                self._line(f"CRC_{message.name}", Coding(8, 1), 0, little=True),
                self._line(f"CNT_{message.name}", Coding(4, 1), 8, little=True),
            ]
            start = _PROTECTED_BITS
        for name, coding in message.signals:
            lines.append(self._line(name, coding, start, self._little))
            start += coding.bits
        return lines

    @staticmethod
    def _line(name: str, coding: Coding, start: int, little: bool) -> str:
        first = start if little else start // 8 * 8 + 7 - start % 8
        layout = f"{first}|{coding.bits}@{int(little)}{'-' if coding.signed else '+'}"
        low, high = coding.limits
        return (
            f" SG_ {name} : {layout} ({coding.factor:.10g},{coding.offset:g}) [{low:.10g}|{high:.10g}] "
            f'"{coding.unit}" Vector__XXX'
        )
