"""Our MCAP against the stock `mcap` reader and the stock `mcap_ros2` decoder, and against itself."""

import hashlib
import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory

from dctorque_can.logs.errors import LogReadError
from dctorque_can.logs.mcap.layout import FRAME_SCHEMA, EventLevel
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH, Table, ros_name
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag, Frames

from ..frames_strategy import a_frame, assert_same_frames, frame, frames_of

START = 1_700_000_000_000_000


def decoded(path):
    """All messages by the stock reader, in file order: (topic, schema name, message record, decoded)."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, schema.name, message, value)
            for schema, channel, message, value in reader.iter_decoded_messages(log_time_order=False)
        ]


def read_frames(path) -> Frames:
    log = open_log(path)
    frames = Frames.concatenate(log.frames())
    assert log.problems == []
    assert log.fraction == 1.0
    return frames


def random_rows(dtype, n, seed=0):
    rng = np.random.default_rng(seed)
    rows = np.zeros(n, dtype)
    for name in dtype.names:
        base, shape = dtype[name].base, (n, *dtype[name].shape)
        if base.kind == "f":
            rows[name] = rng.normal(0, 1e3, shape)
        elif base.kind == "b":
            rows[name] = rng.integers(0, 2, shape)
        else:
            limits = np.iinfo(base)
            rows[name] = rng.integers(limits.min, limits.max, shape, dtype=base, endpoint=True)
    rows["t_us"] = START + np.arange(n) * 1000
    return rows


def test_stock_readers_decode_every_frame(tmp_path):
    path = tmp_path / "log.mcap"
    rows = [
        frame(START, 0x123, b"\x01\x02\x03", channel=0),
        frame(START + 1, 0x1ABCDEF0 | int(EXTENDED_ID), bytes(range(8)), FrameFlag.TRANSMITTED, 1),
        frame(START + 2, 0x7FF, b"", FrameFlag.REMOTE, 0, length=5),
        frame(START + 3, 0, b"", FrameFlag.ERROR, 255),
        frame(START + 4, 0x10, bytes(range(64)), FrameFlag.FD | FrameFlag.BITRATE_SWITCH, 0),
        frame(START + 5, 0x6F0, b"\xff" * 8, FrameFlag.SENT, 0),
    ]
    with McapLog(path) as log:
        log.write_frames(frames_of(rows))
    messages = decoded(path)
    assert [topic for topic, *_ in messages] == [
        "/can0",
        "/can1/tx",
        "/can0",
        "/can255",
        "/can0/fd",
        "/can0/sent",
    ]
    for (t_us, can_id, data, flags, channel, length), (_, kind, record, value) in zip(rows, messages, strict=True):
        assert record.log_time == record.publish_time == t_us * 1000
        stamp = value.header.stamp
        assert stamp.sec * 1_000_000 + stamp.nanosec // 1000 == t_us
        assert value.header.frame_id == f"can{channel}"
        assert value.id == can_id & 0x1FFF_FFFF
        assert value.is_extended == bool(can_id & EXTENDED_ID)
        assert value.is_rtr == bool(flags & FrameFlag.REMOTE)
        assert value.is_error == bool(flags & FrameFlag.ERROR)
        if kind == "can_msgs/msg/Frame":
            assert value.dlc == length
            assert bytes(value.data) == data.ljust(8, b"\0")
        else:
            assert kind == "dctorque_msgs/msg/FdFrame"
            assert (value.is_fd, value.bitrate_switch, value.error_state_indicator) == (True, True, False)
            assert value.length == length
            assert bytes(value.data) == data.ljust(64, b"\0")


@pytest.mark.parametrize("table", [ESTIMATES, HEALTH])
@pytest.mark.parametrize("compression", ["lz4", "zstd", ""])
def test_stock_readers_decode_every_table(tmp_path, table, compression):
    path = tmp_path / "log.mcap"
    rows = random_rows(table.dtype, 50)
    with McapLog(path, compression=compression, chunk_size=4000) as log:
        log.write_table(table, rows)
    messages = decoded(path)
    assert len(messages) == len(rows)
    for row, (topic, kind, record, value) in zip(rows, messages, strict=True):
        assert (topic, kind) == (table.topic, table.type_name)
        assert record.log_time == int(row["t_us"]) * 1000
        assert value.stamp.sec * 1_000_000 + value.stamp.nanosec // 1000 == row["t_us"]
        for name in table.dtype.names[1:]:
            np.testing.assert_array_equal(np.array(getattr(value, name)), row[name], err_msg=name)
    np.testing.assert_array_equal(read_table(path, table), rows)


fields = st.lists(
    st.tuples(
        st.sampled_from(["f8", "f4", "i8", "u8", "i4", "u4", "i2", "u2", "i1", "u1", "?"]),
        st.sampled_from([None, 1, 3]),
    ),
    min_size=1,
    max_size=6,
)


@settings(max_examples=40)
@given(fields, st.booleans(), st.booleans())
def test_any_table_decodes_with_the_stock_decoder(columns, aligned, given_aligned):
    """Whatever gaps there are between its fields, and between those of the rows that are given."""
    descriptions = [("t_us", "i8")] + [
        (f"Signal{i}", kind) if count is None else (f"Signal{i}", kind, (count,))
        for i, (kind, count) in enumerate(columns)
    ]
    dtype = np.dtype(descriptions, align=aligned)
    table = Table.of_signals("Engine_Data-1", dtype)
    rows = random_rows(dtype, 3)
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "log.mcap"
        with McapLog(path) as log:
            log.write_table(table, rows.astype(np.dtype(descriptions, align=given_aligned)))
        messages = decoded(path)
        again = read_table(path, table)
        by_topic = read_table(path, table.topic)
    for row, (_, kind, _, value) in zip(rows, messages, strict=True):
        assert kind == "dctorque_msgs/msg/EngineData1"
        for i in range(len(columns)):
            field = getattr(value, f"signal{i}")  # of bytes, the decoder gives bytes
            np.testing.assert_array_equal(list(field) if isinstance(field, bytes) else field, row[f"Signal{i}"])
    np.testing.assert_array_equal(again, rows)
    for name, ros in table.ros_names.items():
        np.testing.assert_array_equal(by_topic[ros], rows[name])


def test_names_become_ros_names():
    names = {"WheelSpeedFL": "wheel_speed_fl", "clutch1_torque_nm": "clutch1_torque_nm", "ABSActive": "abs_active"}
    assert {name: ros_name(name) for name in names} == names
    assert ros_name("__2nd Gear") == "field_2nd_gear"
    dtype = np.dtype([("t_us", "i8"), ("AB", "f8"), ("ab", "f8"), ("Stamp", "f8")])
    assert list(Table.of_signals("M", dtype).ros_names.values()) == ["ab", "ab_2", "stamp_2"]


def test_events_documents_and_metadata(tmp_path):
    path = tmp_path / "log.mcap"
    documents = {"car.yaml": b"name: car\n", "car.dbc": b'VERSION ""\n'}
    with McapLog(path, documents=documents, metadata={"run": {"host": "bench"}}) as log:
        log.write_event(START, EventLevel.WARNING, "bus", "can0 is down")
        log.write_event(START + 7, EventLevel.INFO, "", "µ")
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        assert {a.name: a.data for a in reader.iter_attachments()} == documents
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        statistics = reader.get_summary().statistics
    assert metadata["run"] == {"host": "bench"}
    assert metadata["dctorque"]["sha256 car.dbc"] == hashlib.sha256(documents["car.dbc"]).hexdigest()
    assert (statistics.message_count, statistics.attachment_count, statistics.metadata_count) == (2, 2, 2)
    (topic, kind, _, first), (*_, second) = decoded(path)
    assert (topic, kind) == ("/dctorque/events", "foxglove_msgs/msg/Log")
    assert (first.level, first.name, first.message) == (3, "bus", "can0 is down")
    assert (second.name, second.message, second.timestamp.nanosec) == ("", "µ", 7000)
    log = open_log(path)
    assert log.documents == documents
    assert log.metadata == metadata


@settings(max_examples=60)
@given(
    st.lists(
        a_frame(
            times=st.integers(-(2**50), 2**52),
            channels=st.integers(0, 255),
            directions=st.sampled_from([FrameFlag(0), FrameFlag.TRANSMITTED, FrameFlag.SENT]),
        ),
        max_size=40,
    ),
    st.sampled_from([200, 2000, 1 << 20]),
    st.integers(1, 50),
)
def test_frames_come_back_bit_for_bit(rows, chunk_size, batch):
    frames = frames_of([row for row in rows if row[0] >= -(2**31) * 10**6])
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "log.mcap"
        with McapLog(path, chunk_size=chunk_size) as log:
            log.write_frames(frames)
        batches = list(open_log(path).frames(batch))
    assert all(len(part) == batch for part in batches[:-1])
    assert_same_frames(Frames.concatenate(batches), frames)


@pytest.mark.parametrize("chunking", [True, False])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_files_of_other_writers(tmp_path, chunking, compression):
    """Schemas inside chunks, no chunks at all, other topics, other frame ids: as `ros2_socketcan` records."""
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=500, compression=compression, use_chunking=chunking)
        writer.start(profile="ros2")
        schema = writer.register_schema("can_msgs/msg/Frame", "ros2msg", FRAME_SCHEMA.encode())
        other = writer.register_schema("Thing", "jsonschema", b"{}")
        bus = writer.register_channel("/from_can_bus", "cdr", schema)
        noise = writer.register_channel("/thing", "json", other)
        for i in range(100):
            name = b"\0" if i % 2 else b"can\0" if i % 3 else b"socketcan\0"
            body = (START // 10**6 + i).to_bytes(4, "little") + (500_000_499).to_bytes(4, "little")
            body += len(name).to_bytes(4, "little") + name
            body += bytes(-len(body) % 4) + (0x100 + i).to_bytes(4, "little") + bytes([0, i % 5 == 0, 0, 8])
            writer.add_message(bus, 5, b"\0\1\0\0" + body + bytes(range(8)), 5)
            writer.add_message(noise, 6, b"{}", 6)
        writer.finish()
    frames = read_frames(path)
    assert frames.t_us.tolist() == [START + i * 10**6 + 500_000 for i in range(100)]
    assert (frames.can_id & 0x7FF).tolist() == [0x100 + i for i in range(100)]
    assert ((frames.can_id & EXTENDED_ID) != 0).tolist() == [i % 5 == 0 for i in range(100)]
    assert frames.channel.tolist() == [0] * 100
    assert frames.data.tolist() == [list(range(8))] * 100


def test_order_of_arrival_is_kept_across_topics(tmp_path):
    """Late frames and several buses: the file order is the order in which the observer saw them."""
    path = tmp_path / "log.mcap"
    rng = np.random.default_rng(0)
    rows = [
        frame(START + int(t), 0x100, bytes([i % 256]), FrameFlag.FD * (i % 3 == 0), i % 4)
        for i, t in enumerate(rng.integers(0, 1000, 500))
    ]
    with McapLog(path, chunk_size=3000) as log:
        for i in range(0, 500, 50):
            log.write_frames(frames_of(rows[i : i + 50]))
            log.write_table(ESTIMATES, random_rows(ESTIMATES.dtype, 5))
    assert_same_frames(read_frames(path), frames_of(rows))
    assert len(read_table(path, ESTIMATES)) == 50


def test_chunk_index_leads_to_every_message(tmp_path):
    """Seeking by time needs true message indexes: each entry must point at a message of its time."""
    path = tmp_path / "log.mcap"
    rows = random_rows(ESTIMATES.dtype, 1000)
    with McapLog(path, chunk_size=20_000) as log:
        for i in range(0, 1000, 100):
            log.write_table(ESTIMATES, rows[i : i + 100])
            log.write_frames(frames_of([frame(START + i, 0x100, b"abc"), frame(START + i, 0x100, b"d", 1)]))
    counts: dict[int, int] = {}
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
            if isinstance(record, Chunk):
                stream, _ = get_chunk_data_stream(record, validate_crc=True)
                data = stream.read(record.uncompressed_size)
            elif isinstance(record, MessageIndex):
                for log_time, offset in record.records:
                    opcode, _, channel, _, time = struct.unpack_from("<BQHIQ", data, offset)
                    assert (opcode, channel, time) == (Opcode.MESSAGE, record.channel_id, log_time)
                    counts[channel] = counts.get(channel, 0) + 1
    assert sorted(counts.values()) == [10, 10, 1000]
    with path.open("rb") as file:
        times = [m.log_time for *_, m in make_reader(file).iter_messages(topics=[ESTIMATES.topic])]
    assert times == [int(t_us) * 1000 for t_us in rows["t_us"]]


def test_sequence_counts_per_channel(tmp_path):
    path = tmp_path / "log.mcap"
    with McapLog(path) as log:
        for _ in range(3):
            log.write_frames(frames_of([frame(channel=0), frame(channel=1), frame(channel=0)]))
    sequences: dict[str, list[int]] = {}
    for topic, _, record, _ in decoded(path):
        sequences.setdefault(topic, []).append(record.sequence)
    assert sequences == {"/can0": list(range(6)), "/can1": list(range(3))}


def test_table_that_is_not_there(tmp_path):
    path = tmp_path / "log.mcap"
    with McapLog(path) as log:
        log.write_event(START, EventLevel.INFO, "a", "b")
    with pytest.raises(LogReadError, match=r"no topic /dctorque/estimates; it has /dctorque/events"):
        read_table(path, ESTIMATES)
    with pytest.raises(LogReadError, match="no table"):
        read_table(path, "/dctorque/events")
    with pytest.raises(LogReadError, match="no such file"):
        read_table(tmp_path / "missing.mcap", ESTIMATES)
