"""What is on the bus when inputs stop: nothing, or that it is not valid; never a value that only looks alive."""

import numpy as np
import pytest

from dctorque_can.bus.output import OutputEncoder
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.pipeline.frames import Frames

STOPS_S = 3.0
MODEL_S = 0.5  # that long the Kalman filter's model stands in for an input (docs/kalman.md)
TIMEOUT_S = 0.1  # of the inputs of the paper's car
UNMAPPED = 0x7DF


def sent(config: Config, frames: Frames, start_us: int) -> list[tuple[float, int, dict[str, float]]]:
    """Return time, identifier and signals of all that is sent in answer."""
    encoder = OutputEncoder(config.output.database, config.output.ids)
    answers = encoder.encode(Chain(config).feed(frames).rows)
    messages = {message.frame_id: message for message in config.output.database.messages}
    times_s = (answers.t_us - start_us) / 1e6
    return [
        (at_s, int(can_id), messages[can_id].decode(bytes(data[: messages[can_id].length]), decode_choices=False))
        for at_s, can_id, data in zip(times_s.tolist(), answers.can_id.tolist(), answers.data, strict=True)
    ]


def stopped(drive: SimulatedDrive, lost: set[int], unmapped: bool = False) -> Frames:
    """Return the drive without some identifiers from `STOPS_S` on, or with a frame of nobody in their places."""
    frames = drive.frames.copy()
    rows = np.isin(frames.can_id, list(lost)) & (frames.t_us >= frames.t_us[0] + round(STOPS_S * 1e6))
    if unmapped:
        frames.can_id[rows] = UNMAPPED
        return frames
    return frames[np.flatnonzero(~rows)]


@pytest.mark.parametrize("unmapped", [False, True])
def test_without_mapped_frames_nothing_is_sent(config: Config, drive: SimulatedDrive, unmapped: bool) -> None:
    every = set(drive.frames.can_id.tolist())
    answers = sent(config, stopped(drive, every, unmapped), int(drive.frames.t_us[0]))
    assert 2.9 < max(at_s for at_s, _, _ in answers) <= STOPS_S


@pytest.mark.parametrize("name", ["EngineData", "InputShafts", "Gearbox"])
def test_without_one_input_values_are_soon_not_available(config: Config, drive: SimulatedDrive, name: str) -> None:
    lost = {config.database.get_message_by_name(name).frame_id}
    answers = sent(config, stopped(drive, lost), int(drive.frames.t_us[0]))
    torque = config.output.database.get_message_by_name("DctClutchTorque")
    highest = {s.name: s.offset + s.scale * ((1 << s.length) - 1) for s in torque.signals if not s.is_signed}
    before = [values for at_s, i, values in answers if i == torque.frame_id and 2.0 < at_s < STOPS_S]
    after = [
        values for at_s, i, values in answers if i == torque.frame_id and at_s > STOPS_S + MODEL_S + TIMEOUT_S
    ]
    assert all(values["Clutch1TorqueValid"] and values["Clutch2TorqueValid"] for values in before)
    assert len(after) > 300
    for values in after:
        assert (values["Clutch1TorqueValid"], values["Clutch2TorqueValid"]) == (0, 0)
        for signal in ("Clutch1Torque", "Clutch2Torque", "ClutchTorqueSum"):
            assert values[signal] == pytest.approx(highest[signal])  # not available
