"""What a recording holds is counted, and told in sentences."""

from dataclasses import replace

import numpy as np

from dctorque_can.analysis.origins import identifier_text
from dctorque_can.analysis.traffic import MappedMessage, Traffic
from dctorque_can.pipeline.frames import EXTENDED_ID, Address, FrameFlag, Frames
from dctorque_can.report.traffic_lines import holds_no_frames, missing_lines, not_our_own, short_lines

MAPPED = (
    MappedMessage("Engine", Address(0x100), 8, 6),
    MappedMessage("Road", Address(0x18FEF100 | EXTENDED_ID), 4, 4),
)
CALM = {"late_frames": 0, "clock_resets": 0}


def frames(rows):
    """Return frames of (identifier, length, channel, flags)."""
    made = Frames.empty(len(rows))
    made.can_id[:] = [row[0] for row in rows]
    made.length[:] = [row[1] for row in rows]
    made.channel[:] = [row[2] for row in rows]
    made.flags[:] = [row[3] for row in rows]
    return made


def counted(*batches):
    traffic = Traffic(MAPPED)
    for batch in batches:
        traffic.take(frames(batch))
    return traffic


def test_frames_are_counted_by_identifier_however_they_are_cut():
    rows = (
        [(0x100, 8, 0, 0)] * 5
        + [(0x18FEF100 | EXTENDED_ID, 4, 0, 0)] * 3
        + [(0x7FF, 1, 0, 0), (0x800 | EXTENDED_ID, 0, 0, 0)]
    )
    order = np.random.default_rng(1).permutation(len(rows))
    rows = [rows[i] for i in order]
    for parts in ([rows], [rows[:4], rows[4:]], [[row] for row in rows]):
        traffic = counted(*parts)
        assert traffic.frames == 10
        assert traffic.mapped_frames == 8
        assert traffic.most_seen(2) == [(0x100, 5), (0x18FEF100 | EXTENDED_ID, 3)]
        assert traffic.as_json()["identifiers"] == {"100": 5, "18FEF100x": 3, "7FF": 1, "800x": 1}
        assert missing_lines(traffic, CALM) == []


def test_nothing_mapped():
    (line,) = missing_lines(counted([(0x321, 8, 0, 0)] * 7 + [(0x100, 8, 0, int(FrameFlag.REMOTE))]), CALM)
    assert line == (
        "none of the 8 frames has a mapped identifier: the log holds 321 (7), 100 (1); "
        "mapped are 100 Engine, 18FEF100x Road"
    )


def test_late_frames_are_told_from_more_than_one_in_a_hundred_on():
    traffic = counted([(0x100, 8, 0, 0)] * 100)
    assert missing_lines(traffic, CALM | {"late_frames": 1}) == []
    (line,) = missing_lines(traffic, CALM | {"late_frames": 2})
    assert line.startswith("2 of 100 mapped frames (2 %) are late")


def test_the_clock_that_went_back():
    (line,) = missing_lines(counted([(0x100, 8, 0, 0)]), CALM | {"clock_resets": 3})
    assert "went back 3 times" in line
    (line,) = missing_lines(counted([(0x100, 8, 0, 0)]), CALM | {"clock_resets": 1})
    assert "went back once" in line


def test_two_channels_with_mapped_identifiers():
    assert missing_lines(counted([(0x100, 8, 0, 0), (0x200, 8, 1, 0)]), CALM) == []
    (line,) = missing_lines(counted([(0x100, 8, 0, 0), (0x100, 8, 3, 0)]), CALM)
    assert line.startswith("channels 0 and 3 both carry mapped identifiers: 100 Engine")


def test_a_message_counts_on_its_channel():
    rows = [(0x100, 8, 0, 0), (0x100, 8, 3, 0), (0x100, 5, 3, 0), (0x200, 8, 3, 0)]
    traffic = Traffic([replace(MAPPED[0], address=Address(0x100, channel=0))])
    traffic.take(frames(rows))
    assert traffic.mapped_frames == 1
    assert missing_lines(traffic, CALM) == []
    traffic = Traffic([replace(MAPPED[0], address=Address(0x100, channel=3))])
    traffic.take(frames(rows))
    assert (traffic.mapped_frames, traffic.messages[0].shortest) == (2, 5)


def test_short_frames():
    rows = [(0x100, 8, 0, 0), (0x100, 6, 0, 0), (0x100, 5, 0, 0), (0x100, 0, 0, int(FrameFlag.REMOTE))]
    traffic = counted(rows, [(0x18FEF100 | EXTENDED_ID, 64, 0, 0)])
    assert short_lines(traffic, lacking=False) == []
    (line,) = short_lines(traffic, lacking=True)
    assert line.startswith(
        "Engine (100): 2 of 3 frames are shorter than the 8 bytes of the DBC, down to 5; mapped"
    )
    (line,) = short_lines(counted(rows[:2]), lacking=False)
    assert line.endswith("down to 6; all mapped signals lie inside")
    assert traffic.as_json()["short_frames"] == {"Engine": {"frames": 2, "shortest": 5}}


def test_a_log_without_frames_says_what_it_holds():
    assert holds_no_frames("a.log", []) == "a.log: the log holds no frames"
    topics = [f"/t{k} (x/msg/T)" for k in range(20)]
    line = holds_no_frames("a.mcap", topics)
    assert "; it holds /t0 (x/msg/T), /t1 (x/msg/T)" in line
    assert "and 8 more" in line
    assert not_our_own(["/dctorque/health (a)", "/signals/Engine (b)", "/imu (c)"]) == ["/imu (c)"]


def test_identifiers_as_text():
    assert [identifier_text(can_id) for can_id in (0x7FF, EXTENDED_ID | 0x7FF, 0)] == ["7FF", "7FFx", "0"]
