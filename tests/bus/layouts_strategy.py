"""Random DBC messages: signals of every size, sign, coding and byte order that do not overlap."""

from cantools.database.can import Message, Signal
from cantools.database.conversion import BaseConversion
from hypothesis import strategies as st

LENGTHS = (1, 2, 3, 4, 5, 6, 7, 8, 12, 64)
SCALES = (1, 2, -1, 0.25, 0.1, 1e-3, 0.03125, -0.5)
OFFSETS = (0, -40, 1000, 0.5, -327.68)


@st.composite
def messages(draw, name="M", frame_id=0x123, floats=True):
    """Return a message whose bytes are cut into stretches of one byte order each."""
    length = draw(st.sampled_from(LENGTHS))
    cuts = sorted(draw(st.sets(st.integers(1, length - 1), max_size=2)) if length > 1 else [])
    signals = []
    for first, end in zip([0, *cuts], [*cuts, length], strict=True):
        order = draw(st.sampled_from(["little_endian", "big_endian"]))
        signals += draw(stretches(first, end, order, len(signals), floats))
    if not signals:
        signals = [Signal("S0", 0, 1, "little_endian")]
    return Message(frame_id, name, length, signals, strict=True)


@st.composite
def stretches(draw, first, end, order, count, floats):
    n_bits = 8 * (end - first)
    position = 0
    signals = []
    while position < n_bits and len(signals) < 8:
        position += draw(st.sampled_from([0, 0, 0, 1, 3, 9]))
        room = min(64, n_bits - position)
        if room < 1:
            break
        lengths = [st.integers(1, room)]
        if floats and room >= 32:
            lengths.append(st.just("float32"))
        if floats and room >= 64:
            lengths.append(st.just("float64"))
        size = draw(st.one_of(lengths))
        is_float = isinstance(size, str)
        bits = int(size[5:]) if is_float else size
        if order == "little_endian":
            start = 8 * first + position
        else:  # the DBC's number of the most significant bit
            start = 8 * (first + position // 8) + 7 - position % 8
        conversion = BaseConversion.factory(
            scale=draw(st.sampled_from(SCALES)), offset=draw(st.sampled_from(OFFSETS)), is_float=is_float
        )
        is_signed = draw(st.booleans())
        name = f"S{count + len(signals)}"
        signals.append(Signal(name, start, bits, order, is_signed=is_signed, conversion=conversion))
        position += bits
    return signals
