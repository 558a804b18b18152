"""Which frames are the messages of a DBC: by identifier, by J1939 number, by channel."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dctorque_can.pipeline.frames import EXTENDED_ID, Frames
from dctorque_can.starter.databases import addresses, own_channels, read_dbc
from dctorque_can.starter.recording import joined

TRUCK = """VERSION ""
BU_: ECU
BO_ 2566848510 EEC1: 8 ECU
 SG_ EngSpd : 24|16@1+ (0.125,0) [0|8031.875] "rpm" ECU
"""


def frames(*can_ids: int, channel: int = 0) -> Frames:
    result = Frames.empty(len(can_ids))
    result.can_id[:], result.length[:], result.channel[:] = can_ids, 8, channel
    result.t_us[:] = 10_000 * np.arange(len(can_ids))
    return result


def test_a_number_from_another_sender_is_j1939(tmp_path: Path) -> None:
    """On the bus it has another priority and source address than in the DBC."""
    (tmp_path / "truck.dbc").write_text(TRUCK)
    dbc = read_dbc(tmp_path / "truck.dbc")
    own = 2566848510
    other = EXTENDED_ID | 0x0C00_0000 | (own & 0x03FF_FF00) | 0x11
    found = addresses([dbc], frames(other, other), {})
    assert found.j1939 == {0}
    assert found.by_name["EEC1"].rows(frames(other)).all()
    exact = addresses([dbc], frames(own, other), {})
    assert exact.j1939 == frozenset()
    assert not exact.by_name


def test_dbcs_that_share_an_identifier_get_channels(tmp_path: Path) -> None:
    for name, message in (("a", "Engine"), ("b", "Brakes")):
        more = f'BO_ 5{ord(name)} More{message}: 8 ECU\n SG_ X : 0|8@1+ (1,0) [0|255] "" ECU\n'
        text = (
            f'VERSION ""\nBU_: ECU\nBO_ 300 {message}: 8 ECU\n SG_ S{name} : 0|8@1+ (1,0) [0|255] "" ECU\n{more}'
        )
        (tmp_path / f"{name}.dbc").write_text(text)
    dbcs = [read_dbc(tmp_path / f"{name}.dbc") for name in "ab"]
    log = Frames.concatenate([frames(300, 598, channel=0), frames(300, 597, channel=3)])
    assert own_channels(dbcs, log) == {0: 3, 1: 0}
    assert own_channels(dbcs[:1], log) == {}
    assert own_channels(dbcs, None) == {}


def test_logs_follow_one_another() -> None:
    """Clocks that begin anew, and long pauses, become two seconds; late frames are sorted."""
    first, second = frames(1, 2, 3), frames(4, 5)
    late = frames(6, 7, 8)
    late.t_us[:] = (5_000_000, 5_200_000, 5_100_000)
    t_us = joined([first, second, late]).t_us
    assert t_us.tolist() == [0, 10_000, 20_000, 2_020_000, 2_030_000, 4_030_000, 4_130_000, 4_230_000]
    assert not len(joined([Frames.empty()]))
