"""Steps of the clock are told from silences, frames out of order, and a process that was held up."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dctorque_can.daemon.clock_watch import FIRST, ClockWatch

S = 1_000_000
OUT_OF_ORDER_US = 100_000


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def watch(told: list[str]) -> ClockWatch:
    watch = ClockWatch(OUT_OF_ORDER_US, lambda is_error, text: told.append(text))
    for i in range(10):
        watch.look(np.array([i * S // 10]), 5.0 + i / 10)
    return watch


@pytest.mark.parametrize(
    ("step_us", "text"),
    [
        (-3600 * S, "back by 3600.000 s"),
        (-OUT_OF_ORDER_US - 110_000, "back by 0.210 s"),
        (3600 * S, "forwards by 3600.000 s"),
        (110_000, "forwards by 0.110 s"),
    ],
)
def test_a_step_is_told_once_and_counted(watch: ClockWatch, told: list[str], step_us: int, text: str) -> None:
    for i in range(10, 20):
        watch.look(np.array([i * S // 10 + step_us]), 5.0 + i / 10)
    assert watch.steps == 1
    assert told == [f"the clock of the frames was set {text}"]


def test_a_silence_is_no_step_and_a_step_in_it_is_told(watch: ClockWatch, told: list[str]) -> None:
    watch.look(np.array([60 * S]), 65.0)
    assert told == []
    watch.look(np.array([90 * S]), 125.0)  # a minute later, of which half is missing: no frame is out of order
    assert told == []
    watch.look(np.array([200 * S]), 126.0)
    assert told == ["the clock of the frames was set forwards by 109.000 s"]


def test_frames_out_of_order_are_no_step(watch: ClockWatch, told: list[str]) -> None:
    watch.look(np.array([950_000, 1_000_000, 950_000, 1_000_000 - OUT_OF_ORDER_US + 50_000, 1_010_000]), 6.0)
    assert told == []


def test_a_process_that_is_held_up_is_no_step(watch: ClockWatch, told: list[str]) -> None:
    """It finds frames of the last three seconds, one a second, and then receives in time again."""
    watch.look(np.array([2 * S, 3 * S, 4 * S]), 9.0)
    for i in range(5, 10):
        watch.look(np.array([i * S]), 5.0 + i)
    assert told == []


def test_frames_that_waited_before_it_began_are_no_step(told: list[str]) -> None:
    watch = ClockWatch(OUT_OF_ORDER_US, lambda is_error, text: told.append(text))
    watch.look(np.array([0, 3 * S]), 5.0)
    watch.look(np.array([4 * S]), 6.0)
    assert told == []


def test_a_drive_that_is_simulated_in_no_time_is_no_step(watch: ClockWatch, told: list[str]) -> None:
    for i in range(10, 1000):
        watch.look(np.array([i * S // 20 + S // 2]), 6.0)
    assert told == []


def test_a_clock_that_never_rests_is_counted_and_told_less_and_less(watch: ClockWatch, told: list[str]) -> None:
    for i in range(1000):
        watch.look(np.array([-i * S]), 6.0)
    assert watch.steps == 1000
    assert len(told) == FIRST + 6  # and 16, 32 … 512
    assert "(step 512)" in told[-1]


@given(
    st.lists(
        st.tuples(st.lists(st.integers(-250_000, 250_000), min_size=1, max_size=5), st.integers(0, 300_000)),
        max_size=20,
    )
)
def test_a_batch_is_judged_as_its_frames_are_one_by_one(batches: list[tuple[list[int], int]]) -> None:
    """Offsets of the stamps of a batch from the true time, and the time until the next batch."""
    told: tuple[list[str], list[str]] = ([], [])
    together, singly = (ClockWatch(OUT_OF_ORDER_US, lambda is_error, text, to=to: to.append(text)) for to in told)
    singly._goes_on = lambda stamps, received_us: False  # type: ignore[method-assign]
    t_us = 0
    for offsets_us, pause_us in batches:
        stamps = np.array(offsets_us) + t_us
        together.look(stamps, t_us / 1e6)
        singly.look(stamps, t_us / 1e6)
        t_us += pause_us
        for name in ("steps", "_latest_us", "_received_us", "_age_us"):
            assert getattr(together, name) == getattr(singly, name), name
    assert told[0] == told[1]
