"""Inputs that are a sum times another signal, or divided by it: against arithmetic on what was sent."""

from dataclasses import replace

import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal
from cantools.database.conversion import BaseConversion

from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.problems import input_problems
from dctorque_can.pipeline.samples import Input, Multiplier, Protection, Quantity, SampleStatus, Term

OK, NOT_AVAILABLE, OUT_OF_RANGE = SampleStatus.OK, SampleStatus.NOT_AVAILABLE, SampleStatus.OUT_OF_RANGE
FAST, SLOW = 0x10, 0x20


def signal(name, start, scale=1.0, offset=0.0):
    conversion = BaseConversion.factory(scale=scale, offset=offset)
    return Signal(name, start, 8, byte_order="little_endian", conversion=conversion)


DATABASE = Database(
    [
        Message(FAST, "Fast", 2, [signal("Share", 0), signal("Less", 8)]),
        Message(SLOW, "Slow", 2, [signal("Reference", 0, 2.0), signal("Counter", 8)]),
    ]
)
SHARES = (
    Term("Fast", "Share", factor=0.01, not_available=frozenset([255])),
    Term("Fast", "Less", factor=-0.01),
)
REFERENCE = Multiplier(Term("Slow", "Reference", not_available=frozenset([255])), 5_000_000)
TORQUE = Input(Quantity.ENGINE_TORQUE, SHARES, -100.0, 300.0, 100_000, multiplier=REFERENCE)


def told(frames, given=TORQUE, protections=()):
    """Return (time in s, value, status) of each sample, one frame after another."""
    decoder = Decoder(DATABASE, (given,), protections)
    found = []
    for t_s, can_id, *data in frames:
        samples = decoder.decode_one(round(t_s * 1e6), can_id, bytes(data))
        found += [(t_s, float(v), int(s)) for v, s in zip(samples.value, samples.status, strict=True)]
    return found


def test_percent_times_reference():
    """50 % less 10 % of 400 N·m; the reference alone gives no sample, and counts from the next sum on."""
    frames = [(0.0, SLOW, 200, 0), (0.01, FAST, 50, 10), (0.02, SLOW, 100, 0), (0.03, FAST, 50, 10)]
    assert told(frames) == [(0.01, pytest.approx(160.0), OK), (0.03, pytest.approx(80.0), OK)]


def test_divided():
    quotient = replace(TORQUE, multiplier=replace(REFERENCE, divides=True))
    frames = [(0.0, SLOW, 4, 0), (0.01, FAST, 50, 10), (0.02, SLOW, 0, 0), (0.03, FAST, 50, 10)]
    assert told(frames, quotient) == [(0.01, pytest.approx(0.4 / 8.0), OK), (0.03, 0.0, NOT_AVAILABLE)]


def test_without_a_reference_there_is_no_value_and_that_is_counted():
    assert told([(0.0, FAST, 50, 10)]) == [(0.0, 0.0, NOT_AVAILABLE)]


def test_the_age_of_the_reference_is_bounded():
    frames = [
        (0.0, SLOW, 200, 0),
        (4.9, FAST, 50, 10),
        (5.0, FAST, 50, 10),
        (5.1, SLOW, 200, 0),
        (5.2, FAST, 50, 10),
    ]
    assert [(t, status) for t, _, status in told(frames)] == [(4.9, OK), (5.0, NOT_AVAILABLE), (5.2, OK)]


def test_either_one_that_is_not_available_makes_the_input_unavailable():
    """The share for its own frame; the reference at once, until it comes again."""
    frames = [
        *((0.0, SLOW, 200, 0), (0.01, FAST, 255, 10), (0.02, FAST, 50, 10), (0.03, SLOW, 255, 0)),
        *((0.04, FAST, 50, 10), (0.05, SLOW, 200, 0), (0.06, FAST, 50, 10)),
    ]
    expected = [(0.01, NOT_AVAILABLE), (0.02, OK), (0.03, NOT_AVAILABLE), (0.04, NOT_AVAILABLE), (0.06, OK)]
    assert [(t, status) for t, _, status in told(frames)] == expected


def test_the_range_is_that_of_the_product():
    frames = [(0.0, SLOW, 200, 0), (0.01, FAST, 90, 10), (0.02, FAST, 70, 10)]
    assert told(frames) == [(0.01, 0.0, OUT_OF_RANGE), (0.02, pytest.approx(240.0), OK)]


def test_a_bad_frame_of_the_reference_is_counted_and_changes_nothing():
    counted = Protection("Slow", counter_signal="Counter", counter_modulus=16)
    frames = [(0.0, SLOW, 200, 1), (1.0, SLOW, 100, 1), (1.01, FAST, 50, 10), (2.0, SLOW), (2.01, FAST, 50, 10)]
    expected = [
        *((1.0, 0.0, SampleStatus.BAD_COUNTER), (1.01, pytest.approx(160.0), OK)),
        *((2.0, 0.0, SampleStatus.BAD_LENGTH), (2.01, pytest.approx(160.0), OK)),
    ]
    assert told(frames, TORQUE, (counted,)) == expected


def test_the_counter_of_a_slow_message_is_held_for_as_long_as_its_value_counts():
    """One second is longer than the timeout of the input, and the step of the counter is wrong all the same."""
    counted = Protection("Slow", counter_signal="Counter", counter_modulus=16)
    frames = [(0.0, SLOW, 200, 1), (1.0, SLOW, 100, 9), (7.0, SLOW, 100, 3), (7.01, FAST, 50, 10)]
    assert told(frames, TORQUE, (counted,)) == [
        (1.0, 0.0, SampleStatus.BAD_COUNTER),
        (7.01, pytest.approx(80.0), OK),
    ]


def test_both_in_one_message():
    one = replace(TORQUE, terms=SHARES[:1], multiplier=Multiplier(Term("Fast", "Less"), 100_000))
    assert told([(0.0, FAST, 50, 10), (0.01, FAST, 20, 30)], one) == [
        (0.0, pytest.approx(5.0), OK),
        (0.01, pytest.approx(6.0), OK),
    ]


def test_any_frames_give_finite_values():
    rng = np.random.default_rng(1)
    frames = [(0.01 * k, rng.choice([FAST, SLOW]), *rng.integers(0, 256, rng.integers(0, 4))) for k in range(400)]
    for divides in (False, True):
        given = replace(TORQUE, multiplier=replace(REFERENCE, divides=divides))
        assert all(
            np.isfinite(value) and (status == OK or value == 0.0) for _, value, status in told(frames, given)
        )


@pytest.mark.parametrize(
    ("multiplier", "reason"),
    [
        (replace(REFERENCE, timeout_us=0), "has a multiplier with a timeout of 0 µs; it must be positive"),
        (replace(REFERENCE, term=Term("Slow", "Referenc")), "is not a signal of Slow"),
        (replace(REFERENCE, term=Term("Fast", "Share")), "is used 2 times; once is right"),
    ],
)
def test_a_multiplier_that_is_wrong(multiplier, reason):
    (problem,) = input_problems(DATABASE, (replace(TORQUE, multiplier=multiplier),), ())
    assert problem.reason == reason
