import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dctorque_can.daemon.log.protocol import (
    Kind,
    MessageSplitter,
    document_message,
    frames_message,
    message,
    read_frames,
    read_table_rows,
    table_message,
)
from dctorque_can.offline.truth_log import TRUTHS
from dctorque_can.pipeline.frames import Frames


@given(
    bodies=st.lists(st.tuples(st.sampled_from(Kind), st.binary(max_size=50)), max_size=8),
    cuts=st.lists(st.integers(1, 30), max_size=20),
)
def test_a_stream_cut_anywhere_gives_the_same_messages(bodies: list[tuple[Kind, bytes]], cuts: list[int]) -> None:
    stream = b"".join(message(kind, body) for kind, body in bodies)
    splitter = MessageSplitter()
    found = []
    for cut in cuts:
        found += list(splitter.feed(stream[:cut]))
        stream = stream[cut:]
    found += list(splitter.feed(stream))
    assert found == bodies


@given(n=st.integers(0, 5), width=st.sampled_from([8, 64]), seed=st.integers(0, 99))
def test_frames_come_out_as_they_went_in(n: int, width: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    frames = Frames(
        random.integers(-(2**62), 2**62, n),
        random.integers(0, 2**32, n, dtype=np.uint32),
        *(random.integers(0, 256, n, dtype=np.uint8) for _ in range(3)),
        random.integers(0, 256, (n, width), dtype=np.uint8),
    )
    ((kind, body),) = MessageSplitter().feed(frames_message(frames))
    back = read_frames(body)
    assert kind == Kind.FRAMES
    for name in ("t_us", "can_id", "length", "flags", "channel", "data"):
        np.testing.assert_array_equal(getattr(back, name), getattr(frames, name))


def test_a_table_comes_out_as_it_went_in() -> None:
    rows = np.zeros(3, TRUTHS.dtype)
    rows["t_us"] = [1, 2, 3]
    rows["clutch1_torque_nm"] = [0.1, -2.0, 1e9]
    rows["changing2"] = [True, False, True]
    ((_, body),) = MessageSplitter().feed(table_message(TRUTHS, rows))
    table, back = read_table_rows(body)
    assert (table.topic, table.type_name) == (TRUTHS.topic, TRUTHS.type_name)
    np.testing.assert_array_equal(back, rows)


def test_a_document_keeps_its_bytes() -> None:
    ((kind, body),) = MessageSplitter().feed(document_message("a.dbc", b"\x00\xff\x00"))
    assert kind == Kind.DOCUMENT
    assert body.partition(b"\0")[::2] == (b"a.dbc", b"\x00\xff\x00")
