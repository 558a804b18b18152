"""What `MessageColumns` leaves out and how it marks multiplexed signals; values are held to cantools elsewhere."""

import cantools
import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal
from cantools.database.conversion import BaseConversion

from dctorque_can.bus.columns import MessageColumns
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

from .demo import DATABASE, frames_of, traffic
from .test_decoder import NESTED


def test_every_message_of_mixed_traffic_is_found_in_order_of_time():
    frames = traffic(20)
    found = MessageColumns(DATABASE).decode(frames)
    assert {name: len(rows) for name, rows in found.items()} == {
        message.name: 20 * 20 // message.cycle_time for message in DATABASE.messages
    }
    for name, rows in found.items():
        message = DATABASE.get_message_by_name(name)
        own = frames[frames.can_id == message.frame_id]
        assert rows["t_us"].tolist() == own.t_us.tolist()
        for row, payload in zip(rows, own.data, strict=True):
            expected = message.decode(payload.tobytes(), decode_choices=False)
            assert {signal: row[signal] for signal in expected} == expected


def test_frames_without_whole_data_are_left_out():
    frames = traffic(2)
    frames.flags[0] = FrameFlag.REMOTE
    frames.flags[1] = FrameFlag.ERROR
    frames.can_id[3] |= EXTENDED_ID
    assert sum(map(len, MessageColumns(DATABASE).decode(frames).values())) == len(frames) - 3
    assert MessageColumns(DATABASE).decode(Frames.empty()) == {}


@pytest.mark.parametrize("there", [0, 1, 2, 4, 6, 7, 8])
@pytest.mark.parametrize("width", [8, 64])
def test_signals_that_a_short_frame_has_not_are_nan(there, width):
    database = cantools.database.load_string(NESTED, "dbc")
    frames = frames_of([[0x31, 7, 1, 0, 0, 0, 0, 5], [0x31, 7, 1, 0, 0, 0, 0, 5]], 100)
    frames.length[0] = there
    frames.data[0, there:] = 0
    if width == 64:
        frames = Frames.concatenate([frames, Frames.empty(0, 64)])
    row, whole = MessageColumns(database).decode(frames)["M"]
    ends = {"Outer": 1, "Inner": 1, "C": 4, "Always": 8}
    for name, end in ends.items():
        assert row[name] == whole[name] if there >= end else np.isnan(row[name])


def test_multiplexed_signals_are_nan_where_they_are_not_selected():
    database = cantools.database.load_string(NESTED, "dbc")
    rows = MessageColumns(database).decode(
        frames_of([[0x30, 7, 1, 0, 0, 0, 0, 5], [0x31, 7, 1, 0, 0, 0, 0, 5]], 100)
    )["M"]
    np.testing.assert_array_equal(rows["A"], [7, np.nan])
    np.testing.assert_array_equal(rows["B"], [np.nan, np.nan])
    np.testing.assert_array_equal(rows["C"], [np.nan, 1])
    np.testing.assert_array_equal(rows["Inner"], [np.nan, 3])
    np.testing.assert_array_equal(rows["Always"], [5, 5])


def test_floats_that_are_no_number_stay_what_they_are():
    message = Message(1, "M", 4, [Signal("F", 0, 32, conversion=BaseConversion.factory(scale=2, is_float=True))])
    patterns = [0x7F80_0001, 0x7FC0_0000, 0x7F80_0000, 0x3F80_0000]  # signalling NaN, NaN, infinity, 1
    payloads = [list(pattern.to_bytes(4, "little")) for pattern in patterns]
    rows = MessageColumns(Database([message])).decode(frames_of(payloads, 1))["M"]
    np.testing.assert_array_equal(rows["F"], [np.nan, np.nan, np.inf, 2.0])


def test_unreadable_signals_and_name_clashes():
    message = Message(1, "M", 16, [Signal("t_us", 0, 8), Signal("Long", 8, 80)])
    columns = MessageColumns(Database([message]))
    assert columns.dtypes["M"].names == ("t_us", "t_us_")
    assert columns.decode(frames_of([[9] * 16], 1))["M"]["t_us_"].tolist() == [9.0]
