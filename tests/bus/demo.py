"""The demo vehicle: its DBC, its inputs as a configuration would give them, and its traffic."""

import math
from pathlib import Path

import numpy as np

from dctorque_can.bus.database import DatabaseFile, load_database
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.protection import declared_protections
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.samples import Input, Quantity, Term

DBC = Path(__file__).resolve().parents[2] / "dbc"
RPM = math.pi / 30.0
WHEEL = 1.0 / 3.6 / 0.312
NO_16_BIT, NO_12_BIT = frozenset([65535]), frozenset([4095])
GEARS = {0: 0.0, 1: 1.0, 2: 2.0, 3: 3.0, 4: 4.0, 5: 5.0, 6: 6.0, 7: 7.0, 13: -1.0, 14: 0.0}

DATABASE = load_database([DatabaseFile(DBC / "demo_car.dbc")])
PROTECTIONS = {each.message: each for each in declared_protections(DATABASE)}


def one(quantity, message, signal, factor=1.0, not_available=frozenset(), values=None):
    term = Term(message, signal, factor, 0.0, not_available, values or {})
    return Input(quantity, (term,), -2000.0, 5000.0, 100_000)


INPUTS = (
    one(Quantity.ENGINE_SPEED, "EngineData", "EngineSpeed", RPM, NO_16_BIT),
    one(Quantity.ENGINE_TORQUE, "EngineData", "EngineTorque", 1.0, NO_12_BIT),
    one(Quantity.SHAFT1_SPEED, "InputShafts", "InputShaft1Speed", RPM, NO_16_BIT),
    one(Quantity.SHAFT2_SPEED, "InputShafts", "InputShaft2Speed", RPM, NO_16_BIT),
    one(Quantity.WHEEL_SPEED_FL, "WheelSpeedsFront", "WheelSpeedFL", WHEEL, NO_16_BIT),
    one(Quantity.WHEEL_SPEED_FR, "WheelSpeedsFront", "WheelSpeedFR", WHEEL, NO_16_BIT),
    one(Quantity.WHEEL_SPEED_RL, "WheelSpeedsRear", "WheelSpeedRL", WHEEL, NO_16_BIT),
    one(Quantity.WHEEL_SPEED_RR, "WheelSpeedsRear", "WheelSpeedRR", WHEEL, NO_16_BIT),
    one(Quantity.GEAR1, "Gearbox", "GearShaft1", values=GEARS),
    one(Quantity.GEAR2, "Gearbox", "GearShaft2", values=GEARS),
    one(Quantity.CLUTCH1_POSITION, "Gearbox", "Clutch1Position", 1.0, NO_12_BIT),
    one(Quantity.CLUTCH2_POSITION, "Gearbox", "Clutch2Position", 1.0, NO_12_BIT),
)


def traffic(cycles, seed=0):
    """Return ``cycles`` times 20 ms of random but correct frames: 8 each."""
    rng = np.random.default_rng(seed)
    parts = []
    for message in DATABASE.messages:
        n = cycles * 20 // message.cycle_time
        protection = PROTECTIONS[message.name]
        own = {protection.crc_signal, protection.counter_signal}
        columns = {s.name: rng.uniform(s.minimum, s.maximum, n) for s in message.signals if s.name not in own}
        frames = frames_of(MessageEncoder(message, protection).encode(columns), message.frame_id)
        frames.t_us[:] = np.arange(n) * message.cycle_time * 1000 + rng.integers(0, 500, n)
        parts.append(frames)
    return Frames.concatenate(parts).sorted_by_time()


def frames_of(payloads, can_id, t_us=None, length=None):
    """Return one frame per payload; 1 ms apart unless told."""
    data = np.atleast_2d(np.asarray(payloads, np.uint8))
    frames = Frames.empty(len(data), 8 if data.shape[1] <= 8 else 64)
    frames.data[:, : data.shape[1]] = data
    frames.length[:] = data.shape[1] if length is None else length
    frames.can_id[:] = can_id
    frames.t_us[:] = np.arange(len(data)) * 1000 if t_us is None else t_us
    return frames


def identical(one, other):
    """Return whether two batches of columns are equal bit for bit."""
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in type(one).__slots__)
