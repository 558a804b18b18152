"""When messages and changes are believed: after many bad frames, after a counter that ran around, after a jump."""

import numpy as np
import pytest
from cantools.database.can import Database, Message, Signal

from dctorque_can.analysis.message_faults import message_faults
from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.pipeline.samples import Input, Protection, Quantity, SampleStatus, Term

from .demo import frames_of

OK, BAD_CRC, BAD_COUNTER = SampleStatus.OK, SampleStatus.BAD_CRC, SampleStatus.BAD_COUNTER
NOT_BELIEVED, BAD_RATE = SampleStatus.NOT_BELIEVED, SampleStatus.BAD_RATE
MESSAGE = Message(0x200, "M", 8, [Signal("Crc", 0, 8), Signal("Counter", 8, 4), Signal("V", 16, 16)])
PROTECTION = Protection("M", "Counter", 15, 8, "e2e_p01", "Crc", 0x1234)
PERIOD_US = 10_000


def decoder(**more):
    given = Input(Quantity.ENGINE_SPEED, (Term("M", "V"),), -1e9, 1e9, 100_000, **more)
    return Decoder(Database([MESSAGE]), [given], [PROTECTION])


def right(n, start=0):
    """Return payloads of n frames with values 0, 1, 2, …"""
    return MessageEncoder(MESSAGE, PROTECTION).encode({"V": np.arange(start + n) % 65536})[start:]


def status_of(bad, n, period_us=PERIOD_US):
    """Return the status of n frames, of which those in ``bad`` have a damaged value."""
    payloads = right(n)
    payloads[list(bad), 3] ^= 0x10
    return decoder().decode(frames_of(payloads, 0x200, np.arange(n) * period_us)).status.tolist()


def test_after_three_bad_frames_three_right_ones_are_asked_for():
    assert status_of({4, 5}, 9) == [OK] * 4 + [BAD_CRC] * 2 + [OK] * 3
    assert status_of({4, 5, 6}, 12) == [OK] * 4 + [BAD_CRC] * 3 + [NOT_BELIEVED] * 2 + [OK] * 3


def test_a_bad_one_in_between_begins_the_count_anew():
    status = status_of({1, 2, 3, 6}, 12)
    assert status[4:] == [NOT_BELIEVED, NOT_BELIEVED, BAD_CRC, NOT_BELIEVED, NOT_BELIEVED, OK, OK, OK]


def test_a_third_of_bad_frames_is_borne_and_half_of_them_is_not():
    n = 3000
    third = status_of(range(0, n, 3), n)
    assert third.count(OK) == 2 * n / 3
    half = status_of(range(0, n, 2), n)
    assert half.count(OK) <= 5
    assert half.count(NOT_BELIEVED) == n / 2 - half.count(OK)


def test_noise_that_passes_a_checksum_is_not_believed():
    """Of 20 000 frames of noise some 78 pass eight bits of checksum, with any value."""
    noise = np.random.default_rng(1).integers(0, 256, (20_000, 8)).astype(np.uint8)
    payloads = np.concatenate([right(10), noise])
    status = decoder().decode(frames_of(payloads, 0x200, np.arange(len(payloads)) * 250)).status[10:]
    assert np.isin(status, [OK, NOT_BELIEVED, BAD_COUNTER]).sum() > 40
    assert (status == OK).sum() == 0


def test_a_gateway_that_sends_each_frame_twice_is_believed():
    payloads = np.repeat(right(100), 2, axis=0)
    status = decoder().decode(frames_of(payloads, 0x200, np.arange(200) * 5_000)).status
    assert status.tolist() == [OK, BAD_COUNTER] * 100


def test_a_message_without_protection_is_always_believed():
    message = Message(0x201, "Plain", 8, [Signal("V", 0, 8)])
    given = Input(Quantity.ENGINE_SPEED, (Term("Plain", "V"),), 0.0, 10.0, 100_000)
    values = np.zeros((40, 8), np.uint8)
    values[:20, 0] = 200
    status = Decoder(Database([message]), [given]).decode(frames_of(values, 0x201)).status
    assert status.tolist() == [SampleStatus.OUT_OF_RANGE] * 20 + [OK] * 20


def test_a_counter_that_ran_around_is_a_larger_step():
    """Sixteen frames of a counter of fifteen: it shows a step of one."""
    payloads = right(60)
    received = [*range(20), *range(35, 60)]
    t_us = np.array(received) * 1_000
    status = decoder().decode(frames_of(payloads[received], 0x200, t_us)).status.tolist()
    assert status == [OK] * 20 + [BAD_COUNTER] + [OK] * 24


@pytest.mark.parametrize("batch", [2, 10, 40])
def test_frames_that_come_in_batches_are_no_counter_that_ran_around(batch):
    n = 400
    t_us = np.arange(n) // batch * batch * 1_000
    status = decoder().decode(frames_of(right(n), 0x200, t_us)).status
    assert (status == OK).all()


def test_what_changes_too_fast_is_left_out_until_three_agree():
    values = [100, 110, 900, 120, 130, 900, 905, 910, 915]
    payloads = MessageEncoder(MESSAGE, PROTECTION).encode({"V": np.array(values)})
    slow = decoder(most_per_s=2000.0)  # 20 in 10 ms
    samples = slow.decode(frames_of(payloads, 0x200, np.arange(len(values)) * PERIOD_US))
    assert samples.status.tolist() == [OK, OK, BAD_RATE, OK, OK, BAD_RATE, BAD_RATE, OK, OK]
    assert samples.value.tolist() == [100, 110, 0, 120, 130, 0, 0, 910, 915]


def test_jitter_rounding_and_a_gap_are_no_jump():
    values = np.array([0, 10, 20, 30, 40, 1000, 1010])
    t_us = np.array([0, 10_000, 24_000, 26_000, 40_000, 400_000, 410_000])  # 10 in 2 ms, then nothing for long
    payloads = MessageEncoder(MESSAGE, PROTECTION).encode({"V": values})
    frames = frames_of(payloads, 0x200, t_us)
    assert set(decoder(most_per_s=1000.0).decode(frames).status) == {OK}
    coarse = MessageEncoder(MESSAGE, PROTECTION).encode({"V": np.array([0, 0, 64, 64])})
    frames = frames_of(coarse, 0x200, np.arange(4) * PERIOD_US)
    assert decoder(most_per_s=1000.0).decode(frames).status.tolist() == [OK, OK, BAD_RATE, BAD_RATE]
    assert set(decoder(most_per_s=1000.0, resolution=64.0).decode(frames).status) == {OK}


def test_a_frame_that_is_out_of_range_is_no_value_to_compare_with():
    message = Message(0x202, "Two", 8, [Signal("A", 0, 16), Signal("B", 16, 16)])
    inputs = [
        Input(Quantity.ENGINE_SPEED, (Term("Two", "A"),), 0.0, 1e5, 100_000, most_per_s=1000.0),
        Input(Quantity.ENGINE_TORQUE, (Term("Two", "B"),), 0.0, 100.0, 100_000),
    ]
    payloads = MessageEncoder(message, Protection("Two")).encode(
        {"A": np.array([10, 5000, 20]), "B": np.array([1, 999, 1])}
    )
    samples = Decoder(Database([message]), inputs).decode(frames_of(payloads, 0x202, np.arange(3) * PERIOD_US))
    bad = SampleStatus.OUT_OF_RANGE
    assert samples.status.tolist() == [OK, OK, bad, bad, OK, OK]


@pytest.mark.parametrize("cut", [1, 7])
def test_cuts_change_nothing(cut):
    rng = np.random.default_rng(3)
    payloads = right(300)
    payloads[rng.random(300) < 0.4, 4] ^= 1
    payloads[100:110, 2:4] = 0xFF
    frames = frames_of(payloads, 0x200, np.cumsum(rng.integers(500, 20_000, 300)))
    whole, parts = decoder(most_per_s=300.0), decoder(most_per_s=300.0)
    expected = whole.decode(frames)
    found = [parts.decode(frames[slice(k, k + cut)]) for k in range(0, 300, cut)]
    assert np.concatenate([each.status for each in found]).tolist() == expected.status.tolist()
    assert parts.messages.tobytes() == whole.messages.tobytes()
    assert parts.changes.tobytes() == whole.changes.tobytes()
    assert len(set(expected.status.tolist())) > 3


def test_what_was_wrong_is_counted_by_message():
    one = decoder(most_per_s=2000.0)
    payloads = right(20)
    payloads[4:7, 3] ^= 0x10
    one.decode(frames_of(payloads[:8], 0x200, np.arange(8) * PERIOD_US))
    told = {"frames": 8, "bad_crc": 3, "not_believed": 1, "believed": False}
    assert message_faults(one.names, one.messages) == {"M": told}
    one.decode(frames_of(payloads[8:], 0x200, np.arange(8, 20) * PERIOD_US))
    assert message_faults(one.names, one.messages)["M"]["believed"] is True
    new = decoder()
    assert message_faults(new.names, new.messages) == {}
