"""A live bus on which one message comes from several places."""

import numpy as np

from dctorque_can.analysis.origins import OriginWatch
from dctorque_can.pipeline.frames import EXTENDED_ID, Address, FrameFlag, Frames, group_mask

EEC1 = 0x0CF0_0400 | EXTENDED_ID
MESSAGES = [
    ("EEC1", Address(EEC1, group_mask(EEC1))),
    ("Engine", Address(0x100)),
    ("Road", Address(0x200, channel=1)),
]


def seen(watch: OriginWatch, *rows: tuple[int, int, int]) -> tuple[bool, list[str]]:
    """Let it see frames of (identifier, channel, flags), one batch."""
    frames = Frames.empty(len(rows))
    frames.can_id[:], frames.channel[:], frames.flags[:] = np.array(rows, np.uint32).T
    return watch.take(frames), watch.news()


def test_several_places_are_told_once_and_others_later():
    watch = OriginWatch(MESSAGES)
    assert seen(watch, (EEC1, 0, 0), (0x100, 0, 0), (0x200, 0, 0)) == (True, [])
    assert seen(watch, (EEC1, 0, 0), (0x200, 0, 0)) == (False, [])
    assert seen(watch, (0x200, 1, 0), (0x200, 2, 0), (0x300, 2, 0)) == (True, [])  # one of them alone counts
    new, (line,) = seen(watch, (0x1800_0000 | EEC1 | 0x31, 0, 0))
    assert new
    assert line.startswith("source addresses 0x00 and 0x31 both send CF00400x EEC1; frames of all of them")
    assert seen(watch, (EEC1, 0, 0), (EEC1 | 0x31, 0, 0))[1] == []
    _, (line,) = seen(watch, (0x100, 2, 0))
    assert line.startswith("channels 0 and 2 both carry mapped identifiers: 100 Engine; ")


def test_what_holds_no_data_counts_for_nothing():
    watch = OriginWatch(MESSAGES)
    for flag in (FrameFlag.REMOTE, FrameFlag.ERROR, FrameFlag.SENT):
        assert seen(watch, (0x100, 0, 0), (0x100, int(flag), int(flag)))[1] == []
    _, (line,) = seen(watch, (0x100, int(FrameFlag.SENT), 0))  # the same identifier and channel, but data
    assert line.startswith("channels 0 and 32 both carry")


def test_a_bus_full_of_nonsense_does_not_fill_the_memory():
    watch = OriginWatch(MESSAGES)
    for k in range(100):
        seen(watch, *((EXTENDED_ID | (1000 * k + n), 0, 0) for n in range(1000)))
    assert len(watch._known) < 6000
