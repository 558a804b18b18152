"""Of each kind of checksum: what is encoded is accepted, and with any one bit flipped it is refused."""

from cantools.database.can import Database, Message, Signal
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.bus.checksum_kinds import KINDS, Coverage
from dctorque_can.bus.decoder import Decoder
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.bus.problems import protection_problems
from dctorque_can.pipeline.frames import EXTENDED_ID
from dctorque_can.pipeline.samples import Input, Protection, Quantity, SampleStatus, Term

NEEDED = {"e2e_p04": (8, 4), "e2e_p06": (0, 5), "e2e_p07": (0, 20), "e2e_p05": (0, 3), "hyundai_canfd": (0, 3)}
"""Bytes of the header in front of the checksum, and from it on."""


def signal(name, bit, bits, big_endian):
    return Signal(name, bit + 7, bits, "big_endian") if big_endian and bits >= 8 else Signal(name, bit, bits)


@st.composite
def protected_messages(draw):
    """Return a message of any length with its checksum at any place, its protection, and its first counter."""
    name = draw(st.sampled_from(sorted(KINDS)))
    kind = KINDS[name]
    before, after = NEEDED.get(name, (0, 2))
    lengths = [n for n in (4, 7, 8, 12, 24, 48, 64) if n >= before + after + 2]
    length = draw(st.sampled_from(lengths))
    byte = draw(st.integers(before, length - after - 1))
    keys = {}
    crc_bit = 8 * byte + (draw(st.sampled_from([0, 4])) if kind.bits == 4 else 0)
    parts = kind.bits == 4 and draw(st.booleans())
    crc = [signal("Crc", crc_bit, kind.bits // 2 if parts else kind.bits, kind.big_endian)]
    free = [bit for bit in range(0, 8 * length, 4) if not 8 * (byte - before) <= bit < 8 * (byte + after)]
    if parts:
        crc.append(Signal("CrcHigh", draw(st.sampled_from(free)), 2))
        free.remove(crc[1].start)
        keys["crc_high_signal"] = "CrcHigh"
    counter_bits = kind.counter_bits or 4
    place = 8 * (byte + kind.counter_at) if kind.counter_at is not None else draw(st.sampled_from(free))
    counter = [signal("Counter", place, counter_bits, kind.big_endian)]
    if kind.counter_bits == 0 and draw(st.booleans()):
        counter = [Signal("Counter", place, 1), Signal("CounterHigh", place + 1, 3)]
        keys["counter_high_signal"] = "CounterHigh"
    value = draw(st.sampled_from([bit for bit in free if bit != place]))
    identifier = draw(st.integers(0, 0x7FF))
    extended = name != "hyundai_canfd" and draw(st.booleans())
    if extended:
        identifier = draw(st.integers(0, 2**29 - 1))
    if name in ("e2e_p01", "e2e_p11"):
        keys["data_id_mode"] = draw(st.sampled_from(["both", "low", "alternating", "nibble"]))
    if kind.open:
        keys["crc_start"] = draw(st.none() | st.integers(0, 2**kind.bits - 1))
        keys["crc_xor"] = draw(st.none() | st.integers(0, 2**kind.bits - 1))
    data_ids = tuple(draw(st.lists(st.integers(0, 255), min_size=16, max_size=16)))
    message = Message(
        *(identifier, "M", length, [*crc, *counter, Signal("Value", value, 4)]),
        is_extended_frame=extended,
        strict=False,
    )
    data_id = draw(
        st.integers(0, 2 ** min(kind.data_id_bits, 12 if keys.get("data_id_mode") == "nibble" else 32) - 1)
    )
    protection = Protection(
        *("M", "Counter", kind.modulus, 3, name, "Crc", data_id),
        *([data_ids] if kind.beside is Coverage.IDS_BY_COUNTER else []),
        **keys,
    )
    return message, protection


@settings(max_examples=150)
@given(protected_messages(), st.integers(0, 20), st.integers(0, 15), st.data())
def test_encoded_is_accepted_and_a_flipped_bit_is_not(made, skipped, value, data):
    message, protection = made
    assert list(protection_problems(message, protection)) == []
    rows = MessageEncoder(message, protection).encode({"Value": [value] * (skipped + 1)})
    payload = bytes(rows[-1])
    inputs = [Input(Quantity.BRAKE, (Term("M", "Value"),), 0.0, 15.0, 100_000)]
    decoder = Decoder(Database([message], strict=False), inputs, [protection])
    can_id = message.frame_id | (EXTENDED_ID if message.is_extended_frame else 0)
    samples = decoder.decode_one(0, can_id, payload)
    assert (samples.status.tolist(), samples.value.tolist()) == ([SampleStatus.OK], [float(value)])
    uncovered = set()
    if KINDS[protection.crc].leaves_counter_out:
        names = protection.counter_signals
        uncovered = {s.start + k for s in message.signals if s.name in names for k in range(s.length)}
    for bit in {data.draw(st.integers(0, 8 * len(payload) - 1)) for _ in range(10)} - uncovered:
        damaged = bytearray(payload)
        damaged[bit // 8] ^= 1 << bit % 8
        samples = decoder.decode_one(10**9, can_id, bytes(damaged))
        assert (samples.status.tolist(), samples.value.tolist()) == ([SampleStatus.BAD_CRC], [0.0])
