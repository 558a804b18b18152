"""When the service did not run, what has waited is late."""

import pytest

from dctorque_can.daemon import stalls
from dctorque_can.daemon.stalls import FIRST, STALL_S, StallWatch
from dctorque_can.daemon.wire.socketcan import MOST


@pytest.fixture(autouse=True)
def _as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stalls, "STALL_S", STALL_S)  # other tests have no opinion on how busy the machine is


def make() -> tuple[StallWatch, list[str]]:
    told: list[str] = []
    return StallWatch(lambda is_error, text: told.append(text)), told


def test_what_waited_during_a_stall_is_late_until_the_queue_is_empty() -> None:
    watch, told = make()
    watch.look(0.0, 3)
    assert not watch.look(0.1, 3)
    assert [watch.look(at_s, n) for at_s, n in ((3.1, MOST), (3.11, MOST), (3.12, 7), (3.13, 4))] == [
        *(True, True, True),
        False,
    ]
    assert (watch.count, round(watch.longest_s, 6)) == (1, 3.0)
    assert told == ["the service did not run for 3.0 s: what it would have sent is left out"]


def test_a_queue_that_never_empties_is_late_no_longer_than_the_stall_took() -> None:
    watch, _ = make()
    watch.look(0.0, 0)
    late = [watch.look(2.0 + 0.1 * k, MOST) for k in range(40)]
    assert late == [True] * 21 + [False] * 19


def test_a_wait_for_frames_is_no_stall() -> None:
    watch, told = make()
    for k in range(1000):
        watch.look(k * 0.9 * STALL_S, k % 2)
    assert (watch.count, told) == (0, [])


def test_of_many_stalls_fewer_and_fewer_are_told() -> None:
    watch, told = make()
    for k in range(66):
        watch.look(2.0 * k, 1)
    assert watch.count == 65
    assert len(told) == FIRST + 3  # 16, 32, 64
