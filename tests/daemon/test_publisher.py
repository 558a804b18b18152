"""It listens before it talks, and is silent where someone else talks."""

from collections.abc import Callable, Sequence
from random import Random

import can
import numpy as np
import pytest

from dctorque_can.bus.output import OutputEncoder
from dctorque_can.config.load import Config
from dctorque_can.daemon.output import publisher as publisher_module
from dctorque_can.daemon.output.foreign import FIRST, LONGER
from dctorque_can.daemon.output.publisher import LISTEN_US, LONGEST_WAIT_US, Publisher
from dctorque_can.daemon.output.send_rate import BURST_S, HEADROOM
from dctorque_can.daemon.wire.link import BusLink
from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.pipeline.frames import FrameFlag, Frames

from ..clock import Clock

START = 1_000_000_000


def heard(
    can_id: int, flags: int = 0, t_us: Sequence[int] = range(START, START + LISTEN_US + 1, 50_000)
) -> Frames:
    frames = Frames.empty(len(t_us))
    frames.t_us[:] = t_us
    frames.can_id[:] = can_id
    frames.flags[:] = flags
    return frames


def rows(after_us: int) -> np.ndarray:
    row = np.zeros(1, ESTIMATE)
    row["t_us"] = START + after_us
    return row


@pytest.fixture
def told() -> list[str]:
    return []


SILENCE_S = 3.0


@pytest.fixture
def make(config: Config, connect: Callable[[], can.BusABC], told: list[str]):
    links = []

    def make(silence_s: float | None = SILENCE_S, seed: int = 0) -> Publisher:
        link = BusLink(connect, lambda is_error, text: None)
        link.open()
        links.append(link)
        encoder = OutputEncoder(config.output.database, config.output.ids)
        tell = lambda is_error, text: told.append(text)  # noqa: E731
        return Publisher(encoder, link, tell, silence_s=silence_s, chance=Random(seed))

    yield make
    for link in links:
        link.close()


@pytest.fixture
def publisher(make: Callable[..., Publisher]) -> Publisher:
    return make()


def ids(config: Config) -> set[int]:
    return {message.frame_id for message in config.output.database.messages}


def test_it_listens_first(publisher: Publisher, config: Config) -> None:
    assert len(publisher.publish(rows(0))) == 0  # has heard nothing at all
    publisher.hear(heard(0x100, t_us=range(START, START + LISTEN_US, 50_000)))
    assert len(publisher.publish(rows(LISTEN_US - 1))) == 0
    publisher.hear(heard(0x100, t_us=[START + LISTEN_US]))
    sent = publisher.publish(rows(LISTEN_US + 200_000))
    assert set(sent.can_id.tolist()) == ids(config)
    assert (sent.flags & FrameFlag.SENT).all()


def test_a_bus_on_which_nobody_else_talks(publisher: Publisher, config: Config) -> None:
    """Other buses tell how long it has listened; whoever uses our identifiers there disturbs nobody."""
    elsewhere = heard(min(ids(config)))
    elsewhere.channel[:] = 5
    publisher.hear(elsewhere, channel=0)
    assert set(publisher.publish(rows(LISTEN_US + 200_000)).can_id.tolist()) == ids(config)
    assert not publisher.refused
    publisher.hear(heard(min(ids(config)), t_us=[START + 2 * LISTEN_US]), channel=0)
    assert publisher.refused == {min(ids(config))}


@pytest.mark.parametrize("step_us", [-3_600_000_000, -1_000, 3_600_000_000])
def test_it_listens_as_long_when_the_clock_is_set_meanwhile(publisher: Publisher, step_us: int) -> None:
    """The step adds as much as the longest silence that counts, and takes nothing away."""
    part = np.arange(0, 200_000, 10_000)
    publisher.hear(heard(0x100, t_us=START + part))
    publisher.hear(heard(0x100, t_us=START + step_us + part))
    assert len(publisher.publish(rows(step_us + 200_000))) == 0
    publisher.hear(heard(0x100, t_us=START + step_us + 200_000 + part))
    assert len(publisher.publish(rows(step_us + 400_000))) > 0


@pytest.mark.parametrize("step_us", [-3_600_000_000, 3_600_000_000])
def test_a_step_of_the_clock_does_not_silence_it(publisher: Publisher, config: Config, step_us: int) -> None:
    publisher.hear(heard(0x100))
    assert set(publisher.publish(rows(LISTEN_US)).can_id.tolist()) == ids(config)
    assert set(publisher.publish(rows(LISTEN_US + step_us)).can_id.tolist()) == ids(config)


def test_a_bus_with_few_frames_is_listened_to_for_longer_and_not_for_ever(publisher: Publisher) -> None:
    few = START + np.arange(LISTEN_US // LONGEST_WAIT_US) * 1_000_000
    publisher.hear(heard(0x100, t_us=few))
    assert len(publisher.publish(rows(0))) == 0
    publisher.hear(heard(0x100, t_us=few[-1:] + 1_000_000))
    assert len(publisher.publish(rows(1_000_000))) > 0


def test_an_identifier_of_someone_else_is_left_alone(
    publisher: Publisher, config: Config, told: list[str]
) -> None:
    taken = min(ids(config))
    publisher.hear(heard(taken))
    publisher.hear(heard(taken))
    sent = publisher.publish(rows(LISTEN_US))
    assert set(sent.can_id.tolist()) == ids(config) - {taken}
    assert len(told) == 1
    assert f"0x{taken:X}" in told[0]
    assert "output.ids" in told[0]


@pytest.mark.parametrize("flag", [FrameFlag.SENT, FrameFlag.ERROR])
def test_our_own_frames_and_error_frames_are_nobody_else(
    publisher: Publisher, config: Config, flag: FrameFlag
) -> None:
    publisher.hear(heard(min(ids(config)), int(flag)))
    assert set(publisher.publish(rows(LISTEN_US)).can_id.tolist()) == ids(config)


def quiet(publisher: Publisher, from_us: int, seconds: float) -> int:
    """Let other frames come for some time; return when the last one did."""
    to_us = from_us + round(1e6 * seconds)
    publisher.hear(heard(0x100, t_us=range(from_us, to_us + 1, 50_000)))
    return to_us


def test_an_identifier_is_ours_again_when_somebody_else_was_silent_for_long_enough(
    publisher: Publisher, config: Config, told: list[str]
) -> None:
    """One frame of an attacker or a tester silences the identifier for a while, and not for good."""
    taken = min(ids(config))
    publisher.hear(heard(0x100))
    publisher.hear(heard(taken, t_us=[START + LISTEN_US + 1]))
    now_us = quiet(publisher, START + LISTEN_US, SILENCE_S - 0.1)
    assert publisher.refused == {taken}
    assert set(publisher.publish(rows(now_us - START)).can_id.tolist()) == ids(config) - {taken}
    now_us = quiet(publisher, now_us, (LONGER - 1.0) * SILENCE_S + 0.2)
    assert publisher.refused == set()
    assert taken in publisher.publish(rows(now_us - START)).can_id.tolist()
    assert told[1:] == [f"nobody else sends on 0x{taken:X} any more: it is sent there again"]
    (seen,) = publisher.as_json()["foreign_ids"].items()
    assert seen == (f"{taken:X}", {"frames": 1, "refusals": 1, "refused": False})


def test_it_is_refused_for_as_long_as_somebody_else_is_heard(publisher: Publisher, config: Config) -> None:
    taken = min(ids(config))
    now_us = START
    for _ in range(20):
        publisher.hear(heard(taken, t_us=[now_us]))
        now_us = quiet(publisher, now_us, 0.9 * SILENCE_S)
        assert publisher.refused == {taken}
    assert publisher.as_json()["foreign_ids"][f"{taken:X}"] == {"frames": 20, "refusals": 1, "refused": True}


def test_it_is_refused_for_good_where_the_vehicle_file_says_so(
    make: Callable[..., Publisher], config: Config, told: list[str]
) -> None:
    publisher = make(silence_s=None)
    publisher.hear(heard(min(ids(config))))
    quiet(publisher, START + LISTEN_US, 100_000.0)
    assert publisher.refused == {min(ids(config))}
    assert "until the next start" in told[0]
    assert len(told) == 1


def test_the_time_of_a_bus_that_is_away_is_no_silence(publisher: Publisher, config: Config) -> None:
    publisher.hear(heard(min(ids(config))))
    publisher._link.close()
    quiet(publisher, START + LISTEN_US, 100.0)
    assert publisher.refused == {min(ids(config))}


@pytest.mark.parametrize("step_us", [-3_600_000_000, 3_600_000_000])
def test_a_step_of_the_clock_is_no_silence(publisher: Publisher, config: Config, step_us: int) -> None:
    publisher.hear(heard(min(ids(config))))
    publisher.hear(heard(0x100, t_us=[START + step_us]))
    assert publisher.refused == {min(ids(config))}
    quiet(publisher, START + step_us, LONGER * SILENCE_S)
    assert publisher.refused == set()


def test_an_attacker_does_not_fill_the_log(publisher: Publisher, config: Config, told: list[str]) -> None:
    now_us = START
    for _ in range(100):
        publisher.hear(heard(min(ids(config)), t_us=[now_us]))
        now_us = quiet(publisher, now_us, LONGER * SILENCE_S + 0.1)
    assert publisher.as_json()["foreign_ids"][f"{min(ids(config)):X}"]["refusals"] == 100
    assert len(told) == 2 * (FIRST + 3)  # 16, 32 and 64 beyond the first ones


def test_two_that_refused_each_other_do_not_come_back_together_for_ever(
    make: Callable[..., Publisher], config: Config
) -> None:
    """Both were started at once; each hears what the other sends."""
    both = [make(seed=1), make(seed=2)]
    together = []
    for k in range(round(30.0 / 0.05)):
        now_us = 50_000 * k
        for one in both:
            one.hear(heard(0x100, t_us=[START + now_us]))
        sent = [one.publish(rows(now_us)) for one in both]
        for one, of_the_other in zip(both, reversed(sent), strict=True):
            if len(of_the_other):
                one.hear(foreign(of_the_other))
        together.append(len(sent[0]) > 0 and len(sent[1]) > 0)
    assert any(together[:20])
    assert not any(together[200:])
    assert sorted(bool(one.refused) for one in both) == [False, True]


def foreign(sent: Frames) -> Frames:
    frames = sent.copy()
    frames.flags[:] = 0
    return frames


def test_what_would_tell_of_the_past_is_not_sent(publisher: Publisher, config: Config) -> None:
    publisher.hear(heard(0x100))
    assert len(publisher.publish(rows(LISTEN_US), late=True)) == 0
    assert publisher.as_json()["late"] == len(ids(config))
    sent = publisher.publish(rows(LISTEN_US + 200_000))
    assert set(sent.can_id.tolist()) == ids(config)


def test_a_clock_that_jumps_back_with_every_frame_does_not_fill_the_bus(
    publisher: Publisher, config: Config, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(publisher_module, "time", clock)
    publisher.hear(heard(0x100))
    sent = 0
    for k in range(4000):
        clock.now_s += 0.001
        sent += len(publisher.publish(rows(LISTEN_US - 200_000 * (k % 2))))
    nominal_hz = sum(1000.0 / (message.cycle_time or 0) for message in config.output.database.messages)
    assert sent <= HEADROOM * nominal_hz * (4.0 + BURST_S) + 1
    assert publisher.as_json()["limited"] > 10_000
    assert ["frames/s are due" in line for line in told] == [True]


def test_the_cycles_that_were_sent_are_measured(
    publisher: Publisher, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(publisher_module, "time", clock)
    publisher.hear(heard(0x100))
    for k in range(101):
        clock.now_s += 0.010 if k % 2 else 0.012
        publisher.publish(rows(LISTEN_US + 10_000 * k))
    cycles = publisher.as_json()["cycles"]
    assert set(cycles) == {message.name for message in config.output.database.messages}
    assert cycles["DctClutchTorque"]["intervals"] == 100
    assert cycles["DctClutchTorque"]["jitter_ms"] == pytest.approx(np.sqrt(0.5 * 2.0**2), abs=0.01)
    assert cycles["DctStatus"]["period_ms"] == 100.0
    worst_ms = max(each["jitter_ms"] for each in cycles.values())
    assert publisher.in_words == f", cycle jitter {worst_ms:.1f} ms"
