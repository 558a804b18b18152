"""Which way the car went, as a whole recording tells: noted while it is fed, foretold when it is fed once more.

While it is fed, each movement from standstill to standstill is noted with the way that was decided for it at last.
When the recording is smoothed, that way holds for the movement from its first moment on. At rest it is only the
sign that speeds are given: the noise of a speed at rest has either sign. The first half of a standstill has that
of the movement before, the second half that of the next one: a car that rolls back and is caught stands for an
instant, in the middle of the time in which it is too slow to tell. A movement that was never decided stays so.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation

LASTING_US = 2**61  # a movement has not ended
MOVEMENTS = 8  # that are noted at a time: of some 1000 samples

DIARY = np.dtype(
    [
        ("count", "i8"),  # movements so far
        ("resets", "i8"),  # so often all was forgotten
        ("moves", "u1"),
        ("from_us", "i8", (MOVEMENTS,)),  # beginning and end of the last movements, by number
        ("until_us", "i8", (MOVEMENTS,)),
        ("way", "i8", (MOVEMENTS,)),  # ±1; 0: never decided
        ("foretold", "i8"),  # how many movements are foretold, in order
        ("foretold_until_us", "i8", (MOVEMENTS,)),
        ("foretold_way", "i8", (MOVEMENTS,)),
    ],
    align=True,
)
"""What was noted and what is foretold."""


@compiled_without_allocation
def note(diary: Any, t_us: int, moves: bool, way: int) -> None:
    """Note that the car moves, and which way if that is decided (else 0), or that it stands."""
    if moves and not diary.moves:
        diary.count += 1
    last = (diary.count - 1) % MOVEMENTS
    if moves and not diary.moves:
        diary.from_us[last], diary.until_us[last], diary.way[last] = t_us, LASTING_US, 0
    if moves and way != 0:
        diary.way[last] = way
    if diary.moves and not moves:
        diary.until_us[last] = t_us
    diary.moves = moves


@compiled_without_allocation
def forget(diary: Any) -> None:
    """Note that the time before a gap says nothing of that after it."""
    diary.resets += 1
    diary.moves = False


def against_gears(diary: NDArray[np.void], rows: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return in which estimates the car, as foretold, goes the other way than its gears are for ``[n]``.

    Args:
        diary: `DIARY` ``[1]``.
        rows: `ESTIMATE` ``[n]``, with the gears.
    """
    count = int(diary["foretold"][0])
    place = np.searchsorted(diary["foretold_until_us"][0, :count], rows["t_us"], side="right")
    way = np.append(diary["foretold_way"][0, :count], 0)[place]
    reverse = (rows["gear1"] < 0) | (rows["gear2"] < 0)
    return np.asarray(np.where(reverse, -way, way) < 0)


@compiled_without_allocation
def foretold(diary: Any, t_us: int) -> int:
    """Return which way the car goes, or will as soon as it moves; 0: nobody knows."""
    for n in range(diary.foretold):
        if t_us < diary.foretold_until_us[n]:
            return int(diary.foretold_way[n])
    return 0


class _Movement(NamedTuple):
    """One movement.

    Attributes:
        resets: before it; −1 if that is not known.
        from_us: its beginning.
        until_us: its end.
        way: ±1, or 0.
    """

    resets: int
    from_us: int = LASTING_US
    until_us: int = LASTING_US
    way: int = 0


class _Stretch(NamedTuple):
    """Counts of a diary before and after some samples."""

    first: int
    end: int
    resets: tuple[int, int]


class Hindsight:
    """Collects the movements of a recording that is fed in stretches, and foretells them.

    Args:
        diary: `DIARY` ``[1]`` before the first stretch.
    """

    def __init__(self, diary: NDArray[np.void]) -> None:
        self._before = diary.copy()
        self._stretches: list[_Stretch] = []
        self._movements: list[_Movement] = []

    def collect(self, diary: NDArray[np.void]) -> None:
        """Take what was noted in the next stretch."""
        was, now = self._before[0], diary[0]
        first, count, resets = int(was["count"]), int(now["count"]), (int(was["resets"]), int(now["resets"]))
        self._stretches.append(_Stretch(first, count, resets))
        self._movements += [_Movement(resets[0] if resets[0] == resets[1] else -1)] * (count - first)
        for number in range(max(first - 1, count - MOVEMENTS, 0), count):
            place = number % MOVEMENTS
            noted = (int(now[name][place]) for name in ("from_us", "until_us", "way"))
            self._movements[number] = _Movement(self._movements[number].resets, *noted)
        self._before = diary.copy()

    def foretell(self, diary: NDArray[np.void], n: int) -> None:
        """Write to the diary what moves in stretch n, and next after it."""
        stretch = self._stretches[n]
        numbers = range(max(stretch.first - 1, 0), min(stretch.end + 1, len(self._movements)))
        known = [self._movements[number] for number in numbers]
        known = [movement for movement in known if movement.resets == stretch.resets[0]]
        if stretch.resets[0] != stretch.resets[1] or len(known) > MOVEMENTS:
            known = []
        diary["foretold"] = len(known)
        for place, movement in enumerate(known):
            next_us = known[place + 1].from_us if place + 1 < len(known) else LASTING_US
            diary["foretold_until_us"][0, place] = (movement.until_us + next_us) // 2
            diary["foretold_way"][0, place] = movement.way
