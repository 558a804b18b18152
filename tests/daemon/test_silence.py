"""A bus that is silent, that never said anything, or that gives nothing but error frames."""

import can

from dctorque_can.daemon.wire.error_frames import CALM_S
from dctorque_can.daemon.wire.silence import SILENCE_S

from ..clock import Clock
from .test_link import MESSAGE, Bus, _on_the_clock, make, receive_all  # noqa: F401  a fixture of every test


def error_frame(can_id: int, controller: int = 0) -> can.Message:
    data = bytes([0, controller, 0, 0, 0, 0, 0, 0])
    return can.Message(arbitration_id=can_id, is_error_frame=True, is_extended_id=False, dlc=8, data=data)


def test_a_silence_is_told_once_and_its_end_too(clock: Clock) -> None:
    bus = Bus([])
    link, told = make(bus)
    link.open()
    for silence_s in (2.5, 3.5):
        bus.events.append(MESSAGE)
        assert len(link.receive(0.0)) == 1
        before = len(told)
        clock.now_s += SILENCE_S - 0.25
        link.receive(0.0)
        assert len(told) == before
        clock.now_s += silence_s - (SILENCE_S - 0.25)
        receive_all(link, 3)
    assert told == [
        "no frame for 2 s on a bus of tests",
        "frames again after 2.5 s on a bus of tests",
        "no frame for 2 s on a bus of tests",
    ]
    assert link.counts.silences == 2
    assert (link.counts.lost, link.up, bus.closed) == (0, True, False)


def test_a_bus_that_never_says_anything_is_told_once_with_what_to_look_at(clock: Clock) -> None:
    bus = Bus([])
    link, told = make(bus)
    link.open()
    clock.now_s += 100.0  # until somebody listens, a log is opened
    link.receive(0.0)
    clock.now_s += SILENCE_S - 0.25
    link.receive(0.0)
    assert (told, link.mute) == ([], None)
    clock.now_s += 0.5
    receive_all(link, 3)
    (line,) = told
    assert line.startswith("no frame at all for 2 s on a bus of tests")
    for cause in ("ignition", "channel", "bit rate", "terminated"):
        assert cause in line
    assert link.mute == line
    clock.now_s += 100.0
    receive_all(link, 3)
    bus.events.append(MESSAGE)
    receive_all(link, 1)
    assert told[1:] == ["first frame on a bus of tests"]
    assert (link.mute, link.counts.silences) == (None, 0)


def test_a_bus_of_nothing_but_error_frames_is_told_as_one_of_the_wrong_bit_rate(clock: Clock) -> None:
    link, told = make(Bus([error_frame(0x88)] * 1000))
    link.open()
    for _ in range(3):
        link.receive(0.0)
        clock.now_s += SILENCE_S / 2
    assert "error frames: frames on the bus are damaged" in told[0]
    assert told[1].startswith("nothing but ")
    assert "does the bit rate fit?" in told[1]
    assert len(told) == 2
    assert link.mute is not None


def test_the_first_error_frame_of_a_bout_is_told_in_words(clock: Clock) -> None:
    first = [MESSAGE, *[error_frame(0x20)] * 3, None]
    link, told = make(Bus([*first, MESSAGE, error_frame(0x20), None, MESSAGE, error_frame(0x04, 0x30)]))
    link.open()
    link.receive(0.0)
    clock.now_s += CALM_S - 0.5
    link.receive(0.0)
    assert len(told) == 1
    assert told[0].startswith("a bus of tests: error frames: nobody acknowledges what is sent")
    clock.now_s += CALM_S
    link.receive(0.0)
    assert "so many errors that the controller is passive" in told[1]
    assert link.counts.error_frames == 5


def test_a_controller_that_leaves_the_bus_again_and_again_is_told_once_a_while(clock: Clock) -> None:
    link, told = make(Bus([error_frame(0x40), MESSAGE, None] * 3))
    link.open()
    for pause_s in (0.1, CALM_S - 0.5, CALM_S):
        link.receive(0.0)
        clock.now_s += pause_s
    assert link.counts.bus_offs == 3
    assert ["bus-off" in line for line in told] == [True]
    assert "restart-ms" in told[0]
