"""Inputs whose validity another signal tells, in the same message or another one."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal

from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.problems import input_problems
from dctorque_can.pipeline.samples import Input, Multiplier, Protection, Quantity, SampleStatus, Term, Validity

from .demo import frames_of, identical

OK, NOT_AVAILABLE = int(SampleStatus.OK), int(SampleStatus.NOT_AVAILABLE)
FAST, SLOW = 0x10, 0x20
DATABASE = Database(
    [
        Message(FAST, "Fast", 3, [Signal("Speed", 0, 8), Signal("Valid", 8, 2), Signal("Other", 16, 8)]),
        Message(SLOW, "Slow", 2, [Signal("Quality", 0, 4), Signal("Counter", 8, 4), Signal("Factor", 12, 4)]),
    ]
)
SPEED = Input(Quantity.ENGINE_SPEED, (Term("Fast", "Speed"),), 0.0, 250.0, 100_000)
IN_SAME = replace(SPEED, validity=Validity(Term("Fast", "Valid", values={1: 1.0, 2: 1.0}), 5_000_000))
IN_OTHER = replace(SPEED, validity=Validity(Term("Slow", "Quality", values={3: 1.0}), 5_000_000))
OTHER = Input(Quantity.ENGINE_TORQUE, (Term("Fast", "Other"),), 0.0, 250.0, 100_000)


def told(frames, inputs, protections=()):
    """Return (time in s, quantity, value, status) of each sample, one frame after another."""
    decoder = Decoder(DATABASE, inputs, protections)
    found = []
    for t_s, can_id, *data in frames:
        samples = decoder.decode_one(round(t_s * 1e6), can_id, bytes(data))
        rows = zip(samples.quantity, samples.value, samples.status, strict=True)
        found += [(t_s, int(q), float(v), int(s)) for q, v, s in rows]
    return found


def test_a_bit_in_the_same_message_counts_at_once_and_for_its_input_alone():
    frames = [(0.01 * k, FAST, 10 + k, bit, 7) for k, bit in enumerate([0, 1, 2, 3, 1])]
    expected = []
    for k, bit in enumerate([0, 1, 2, 3, 1]):
        valid = bit in (1, 2)
        expected.append((0.01 * k, 0, 10.0 + k if valid else 0.0, OK if valid else NOT_AVAILABLE))
        expected.append((0.01 * k, 1, 7.0, OK))
    assert told(frames, (IN_SAME, OTHER)) == expected


def test_the_latest_value_of_another_message_counts_until_it_is_too_old():
    frames = [
        *((0.0, FAST, 10, 0, 0), (0.5, SLOW, 3, 0), (0.51, FAST, 11, 0, 0)),
        *((5.4, FAST, 12, 0, 0), (5.5, FAST, 13, 0, 0), (5.6, SLOW, 3, 0), (5.61, FAST, 14, 0, 0)),
    ]
    assert [(t, v, s) for t, _, v, s in told(frames, (IN_OTHER,))] == [
        *((0.0, 0.0, NOT_AVAILABLE), (0.51, 11.0, OK), (5.4, 12.0, OK)),
        *((5.5, 0.0, NOT_AVAILABLE), (5.61, 14.0, OK)),
    ]


def test_a_message_that_tells_of_the_end_of_validity_is_counted_itself():
    frames = [(0.0, SLOW, 3, 0), (0.01, FAST, 10, 0, 0), (0.02, SLOW, 2, 0), (0.03, FAST, 11, 0, 0)]
    assert [(t, v, s) for t, _, v, s in told(frames, (IN_OTHER,))] == [
        (0.01, 10.0, OK),
        (0.02, 0.0, NOT_AVAILABLE),
        (0.03, 0.0, NOT_AVAILABLE),
    ]


def test_a_bad_frame_does_not_change_what_is_valid():
    counted = Protection("Slow", counter_signal="Counter")
    frames = [(0.0, SLOW, 3, 1), (0.01, SLOW, 0, 1), (0.02, FAST, 10, 0, 0)]
    assert [(t, v, s) for t, _, v, s in told(frames, (IN_OTHER,), (counted,))] == [
        (0.01, 0.0, int(SampleStatus.BAD_COUNTER)),
        (0.02, 10.0, OK),
    ]


def test_a_frame_that_ends_before_the_bit_is_not_valid():
    """Of one byte only the speed lies inside."""
    assert [(v, s) for _, _, v, s in told([(0.0, FAST, 10, 1, 0), (0.01, FAST, 11)], (IN_SAME,))] == [
        (10.0, OK),
        (0.0, NOT_AVAILABLE),
    ]


def test_a_frame_that_ends_before_its_multiplier_has_no_product():
    product = replace(SPEED, multiplier=Multiplier(Term("Fast", "Other"), 5_000_000))
    assert [(v, s) for _, _, v, s in told([(0.0, FAST, 10, 0, 4), (0.01, FAST, 11)], (product,))] == [
        (40.0, OK),
        (0.0, NOT_AVAILABLE),
    ]


def test_beside_a_multiplier():
    both = replace(IN_OTHER, multiplier=Multiplier(Term("Slow", "Factor"), 5_000_000))
    frames = [(0.0, SLOW, 3, 0x20), (0.01, FAST, 10, 0, 0), (0.02, SLOW, 1, 0x30), (0.03, FAST, 10, 0, 0)]
    assert [(t, v, s) for t, _, v, s in told(frames, (both,))] == [
        (0.01, 20.0, OK),
        (0.02, 0.0, NOT_AVAILABLE),
        (0.03, 0.0, NOT_AVAILABLE),
    ]


@pytest.mark.parametrize("seed", range(5))
def test_cut_anywhere_it_is_the_same(seed):
    rng = np.random.default_rng(seed)
    n = 300
    frames = frames_of(rng.integers(0, 4, (n, 3)), 0, np.cumsum(rng.integers(0, 200_000, n)))
    frames.can_id[:] = rng.choice([FAST, SLOW], n)
    frames.length[:] = rng.choice([1, 2, 3], n)
    inputs = (IN_OTHER, replace(OTHER, validity=IN_SAME.validity))
    whole = Decoder(DATABASE, inputs).decode(frames)
    decoder = Decoder(DATABASE, inputs)
    cuts = [0, *sorted(rng.integers(0, n, 20)), n]
    parts = [decoder.decode(frames[a:b]) for a, b in pairwise(cuts)]
    joined = type(whole)(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in type(whole).__slots__)
    )
    assert identical(whole, joined)
    assert {OK, NOT_AVAILABLE} <= set(whole.status.tolist())


@pytest.mark.parametrize(
    ("validity", "reason"),
    [
        (replace(IN_OTHER.validity, timeout_us=0), "has a validity with a timeout of 0 µs; it must be positive"),
        (replace(IN_OTHER.validity, term=Term("Slow", "Qualit", values={1: 1.0})), "is not a signal of Slow"),
        (
            replace(IN_OTHER.validity, term=Term("Slow", "Quality", values={16: 1.0})),
            "cannot have the raw value 16",
        ),
        (
            replace(IN_OTHER.validity, term=Term("Slow", "Quality")),
            "has a validity without a raw value that means",
        ),
        (
            replace(IN_OTHER.validity, term=Term("Fast", "Speed", values={1: 1.0})),
            "is used 2 times; once is right",
        ),
    ],
)
def test_a_validity_that_is_wrong(validity, reason):
    (problem,) = input_problems(DATABASE, (replace(SPEED, validity=validity),), ())
    assert problem.reason.startswith(reason)
