"""Frames of which none is mapped are told, with what came instead."""

import numpy as np
import pytest

from dctorque_can.analysis.traffic import MappedMessage
from dctorque_can.daemon.traffic_watch import PATIENCE_S, TrafficWatch
from dctorque_can.pipeline.frames import EXTENDED_ID, Address, FrameFlag, Frames

ENGINE = MappedMessage("EngineData", Address(0x100), 8, 8)


def frames(*can_ids: int, flags: int = 0) -> Frames:
    batch = Frames.empty(len(can_ids))
    batch.can_id[:] = can_ids
    batch.flags[:] = flags
    return batch


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def watch(told: list[str]) -> TrafficWatch:
    return TrafficWatch([ENGINE], lambda is_error, text: told.append(text))


def test_it_is_told_after_two_seconds_with_the_identifiers_most_seen(watch: TrafficWatch, told: list[str]) -> None:
    watch.keep_time(50.0)  # nothing came: that is a silence
    watch.take(frames(0x7DF, 0x321, 0x321, 0x18FEF100 | EXTENDED_ID), 100.0)
    watch.keep_time(100.0 + PATIENCE_S - 0.1)
    assert told == []
    for _ in range(3):
        watch.keep_time(100.0 + PATIENCE_S)
    (line,) = told
    assert line.startswith("none of the 4 frames has a mapped identifier: most seen are 321 (2), 7DF (1)")
    assert "18FEF100x (1)" in line
    assert "mapped are 100 EngineData" in line
    watch.take(frames(0x321), 200.0)
    assert watch.lines()[0].startswith("none of the 5 frames")
    watch.take(frames(0x321, 0x100), 201.0)
    assert told[1:] == ["the first mapped frame has come"]
    assert (watch.mapped, watch.lines()) == (True, [])


def test_a_bus_with_a_mapped_frame_is_not_told(watch: TrafficWatch, told: list[str]) -> None:
    watch.take(frames(0x321), 0.0)
    watch.take(frames(0x100), 1.9)
    watch.keep_time(100.0)
    assert (told, watch.lines()) == ([], [])


@pytest.mark.parametrize("flag", [FrameFlag.ERROR, FrameFlag.REMOTE, FrameFlag.SENT])
def test_what_is_no_data_of_others_is_no_mapped_frame(watch: TrafficWatch, told: list[str], flag: int) -> None:
    watch.take(frames(0x100, flags=flag), 0.0)
    watch.keep_time(100.0)
    assert (watch.mapped, told) == (False, [])


def test_nonsense_does_not_fill_the_memory(watch: TrafficWatch) -> None:
    ids = np.arange(1 << 16) | EXTENDED_ID
    for part in np.split(ids, 64):
        watch.take(frames(*part.tolist()), 0.0)
    assert watch._traffic.extended_identifiers <= 4096 + 1024
