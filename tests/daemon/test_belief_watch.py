"""What is told when a protected message is not believed any more, and in the summary of a run."""

from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from dctorque_can.bus.belief import BELIEF
from dctorque_can.config.load import Config
from dctorque_can.daemon.belief_watch import FIRST, BeliefWatch
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.pipeline.samples import SampleStatus
from dctorque_can.report.message_lines import message_lines

from .test_service import Connect, send, start


def watched() -> tuple[np.ndarray, BeliefWatch, list[tuple[bool, str]]]:
    messages, told = np.zeros(2, np.dtype(BELIEF)), []
    watch = BeliefWatch(["Engine", "Gearbox"], messages, lambda is_error, text: told.append((is_error, text)))
    return messages, watch, told


def test_each_change_is_told_with_what_was_wrong() -> None:
    messages, watch, told = watched()
    watch.look()
    assert told == []
    messages["counts"][1][SampleStatus.BAD_CRC] = 5
    messages["doubted"][1] = messages["doubts"][1] = 1
    watch.look()
    watch.look()
    messages["doubted"][1] = 0
    watch.look()
    assert told == [
        (
            True,
            "Gearbox: not believed: too many of its frames are bad (so far 5 with a wrong checksum); its signals "
            "are left out until 3 right ones follow each other",
        ),
        (False, "Gearbox: believed again"),
    ]


def test_of_many_changes_fewer_and_fewer_are_told() -> None:
    messages, watch, told = watched()
    for k in range(2000):
        messages["doubted"][0] = 1 - k % 2
        messages["doubts"][0] += messages["doubted"][0]
        watch.look()
    assert 2 * FIRST <= len(told) < 2 * FIRST + 20


def test_one_that_is_over_within_a_batch_is_told_too() -> None:
    messages, watch, told = watched()
    messages["doubts"][0] = 1
    watch.look()
    assert [is_error for is_error, _ in told] == [True, False]


def test_the_summary_says_what_was_wrong() -> None:
    lines = message_lines(
        {
            "Engine": {"frames": 100, "bad_crc": 3, "not_believed": 2, "believed": True},
            "Gearbox": {"frames": 50, "bad_counter": 50, "believed": False},
        }
    )
    assert list(lines) == [
        "Engine: of 100 frames 3 with a wrong checksum, 2 right, but not believed",
        "Gearbox: of 50 frames 50 with a wrong counter; not believed at the end",
    ]


def test_a_service_tells_of_a_message_that_is_not_believed_and_logs_it(
    config: Config, connect: Connect, drive: SimulatedDrive, folder: Path
) -> None:
    frames = drive.frames[slice(0, 700)].copy()
    engine = np.flatnonzero(frames.can_id == config.database.get_message_by_name("EngineData").frame_id)
    frames.data[engine[20:26], 3] ^= 0x40
    live = start(config, connect, folder / "live.mcap")
    send(connect, frames)
    live.wait_for(len(frames))
    summary = live.stop()
    told = [line for line in live.told if line.startswith("EngineData: ")]
    assert told[0].startswith("EngineData: not believed: too many of its frames are bad")
    assert told[1:] == ["EngineData: believed again"]
    counts = summary.messages["EngineData"]
    assert (counts["frames"], counts["bad_crc"], counts["believed"]) == (len(engine), 6, True)
    assert counts["not_believed"] == 2
    assert summary.health["not_believed"]["engine_speed"] == 2
    with (folder / "live.mcap").open("rb") as log:
        events = [message.data for _, _, message in make_reader(log).iter_messages(topics=["/dctorque/events"])]
    assert sum(b"EngineData: " in event for event in events) == 2
