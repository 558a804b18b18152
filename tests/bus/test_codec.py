"""Decoder, encoder and columns against cantools, over random layouts and payloads."""

import math

import numpy as np
import pytest
from cantools.database.can import Database
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.bus.columns import MessageColumns
from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.pipeline.samples import N_QUANTITIES, Input, Quantity, SampleStatus, Term

from .demo import frames_of
from .layouts_strategy import messages

EXACT = 2**53  # integers up to here are exact in float64, so that both sides must agree in every bit


def physical(message, payload):
    """Return cantools' raw values and the physical ones, unrounded, by the definition of the DBC."""
    raws = message.decode(payload, decode_choices=False, scaling=False)
    scaled = message.decode(payload, decode_choices=False)
    return raws, scaled


def payloads_of(message):
    size = message.length
    corner = st.sampled_from([b"\x00" * size, b"\xff" * size, b"\x80" + b"\x00" * (size - 1)])
    return st.lists(st.one_of(corner, st.binary(min_size=size, max_size=size)), min_size=1, max_size=5)


@settings(max_examples=150)
@given(st.data())
def test_every_signal_has_the_value_that_cantools_reads(data):
    message = data.draw(messages())
    payloads = data.draw(payloads_of(message))
    chosen = message.signals[:N_QUANTITIES]
    factor, offset = data.draw(st.sampled_from([(1.0, 0.0), (0.1047, -3.0), (-2.5, 0.1)]))
    inputs = [
        Input(Quantity(k), (Term("M", signal.name, factor, offset),), -math.inf, math.inf, 10**6)
        for k, signal in enumerate(chosen)
    ]
    database = Database([message])
    frames = frames_of([list(payload) for payload in payloads], message.frame_id)
    samples = Decoder(database, inputs).decode(frames)
    columns = MessageColumns(database).decode(frames)["M"]
    assert len(samples) == len(payloads) * len(chosen)
    assert samples.quantity.tolist() == list(range(len(chosen))) * len(payloads)
    assert samples.last.tolist() == ([False] * (len(chosen) - 1) + [True]) * len(payloads)
    at = 0
    for row, payload in enumerate(payloads):
        raws, scaled = physical(message, payload)
        for signal in chosen:
            expected = float(raws[signal.name]) * float(signal.scale) + float(signal.offset)
            if abs(raws[signal.name]) < EXACT:
                assert expected == float(scaled[signal.name])
            column = columns[signal.name][row]
            assert column == expected or (math.isnan(column) and math.isnan(expected))
            value = factor * expected + offset
            if math.isfinite(value):
                assert (samples.status[at], samples.value[at]) == (SampleStatus.OK, value)
            else:
                assert (samples.status[at], samples.value[at]) == (SampleStatus.NOT_AVAILABLE, 0.0)
            at += 1


@settings(max_examples=150)
@given(st.data())
def test_encoding_then_cantools_gives_the_nearest_value_in_range(data):
    message = data.draw(messages())
    n = data.draw(st.integers(1, 4))
    numbers = st.floats(allow_nan=False) | st.integers(-300, 300).map(float)
    columns = {s.name: data.draw(st.lists(numbers, min_size=n, max_size=n)) for s in message.signals}
    payloads = MessageEncoder(message).encode(columns)
    assert payloads.shape == (n, message.length)
    for row in range(n):
        raws = message.decode(bytes(payloads[row]), decode_choices=False, scaling=False)
        for signal in message.signals:
            wanted = (columns[signal.name][row] - float(signal.offset)) / float(signal.scale)
            raw = raws[signal.name]
            if signal.is_float:
                largest = float(np.finfo(np.float32 if signal.length == 32 else np.float64).max)
                limited = min(max(wanted, -largest), largest)
                assert raw == pytest.approx(limited, rel=1e-6, abs=1e-44)
                continue
            low = -(2 ** (signal.length - 1)) if signal.is_signed else 0
            high = low + 2**signal.length - 1
            if low <= wanted <= high and abs(wanted) < EXACT:
                assert raw == round(wanted)
            elif wanted > high:
                assert high - high // EXACT <= raw <= high  # beyond 53 bits the nearest float below
            elif wanted < low:
                assert raw == low


@settings(max_examples=100)
@given(st.data())
def test_encoding_values_on_the_grid_gives_the_bytes_of_cantools(data):
    message = data.draw(messages(floats=False))
    payload = data.draw(st.binary(min_size=message.length, max_size=message.length))
    scaled = message.decode(payload, decode_choices=False)
    raws = message.decode(payload, decode_choices=False, scaling=False)
    expected = message.encode(raws, scaling=False, strict=False)
    if all(abs(raw) < 2**44 for raw in raws.values()):  # fine enough to undo scale and offset in float64
        assert bytes(MessageEncoder(message).encode(scaled)[0]) == expected
