"""Where each frame that passed on the bus went: into a log, once and unaltered, or not."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dctorque_can.pipeline.frames import FrameFlag, Frames

from .bus import Bus
from .run import Event
from .service import Life
from .traffic import NUMBERED, NUMBERED_IDS

ALIKE = 16


@dataclass
class LifeAccount:
    """What became of the frames of one process of the service.

    Attributes:
        life: whose.
        fetched: frames that it received, None where nobody knows.
        logged: of these, in a log.
        between: frames that passed between two that are logged, and are not; of these, …
        explained: … those at an interface that went down.
        missing: received and in no log.
        dropped: frames that it says are in no log, received or sent.
        lost_ms: of a kill, from receiving the first one that is missing to the kill.
        heard: frames of it that were heard on the bus, …
        unlogged: … of these, not in a log as sent; …
        unlogged_ms: … from hearing the first of them to the end of the process.
        unheard: frames in a log as sent that were not heard.
    """

    life: Life
    fetched: int | None = None
    logged: int = 0
    between: int = 0
    explained: int = 0
    missing: int = 0
    dropped: int = 0
    lost_ms: float | None = None
    heard: int = 0
    unlogged: int = 0
    unlogged_ms: float = 0.0
    unheard: int = 0


@dataclass
class Account:
    """Of all frames.

    Attributes:
        passed: frames on the bus.
        altered: frames in logs that were not on the bus as they are.
        twice: frames that are in logs twice, or in another order than on the bus.
        lives: of each process.
        log_again_s: for each event, from its end to the first frame after it that is in a log; None: never.
    """

    passed: int
    altered: int = 0
    twice: int = 0
    lives: list[LifeAccount] = field(default_factory=list)
    log_again_s: list[float | None] = field(default_factory=list)


class Places:
    """Finds frames of logs among those that passed on the bus."""

    def __init__(self, passed: NDArray[np.void]) -> None:
        self.passed = passed
        self.taken = np.zeros(len(passed), np.bool_)
        self.altered = self.twice = 0
        rows = np.flatnonzero((passed["can_id"] >= NUMBERED) & (passed["can_id"] < NUMBERED + NUMBERED_IDS))
        numbers = passed["data"][rows].copy().view("<u8").ravel().astype(np.int64)
        self._row_of = np.full(int(numbers[-1]) + 1 if len(numbers) else 0, -1)
        self._row_of[numbers] = rows
        self._last = -1

    def take(self, frames: Frames) -> NDArray[np.int64]:
        """Return where the frames of a log are, -1 for altered ones; logs come in their order."""
        where = self._find(frames)
        found = where[where >= 0]
        self.altered += len(where) - len(found)
        self.twice += int(self.taken[found].sum() + (np.diff(found, prepend=self._last) <= 0).sum())
        self.taken[found] = True
        if len(found):
            self._last = int(found[-1])
        return where

    def _find(self, frames: Frames) -> NDArray[np.int64]:
        numbered = np.flatnonzero((frames.can_id >= NUMBERED) & (frames.can_id < NUMBERED + NUMBERED_IDS))
        numbers = frames.data[numbered, :8].copy().view("<u8").ravel()
        known = numbers < len(self._row_of)
        numbered, rows = numbered[known], self._row_of[numbers[known].astype(np.int64)]
        numbered, rows = numbered[rows >= 0], rows[rows >= 0]
        if not len(rows):
            return np.full(len(frames), -1)
        at = np.arange(len(frames))
        before = np.searchsorted(numbered, at, "right") - 1
        after = np.minimum(before + 1, len(rows) - 1)
        forwards = np.where(before >= 0, rows[before] + at - numbered[before], -1)
        forwards[(after > before) & (forwards >= rows[after])] = -1
        backwards = rows[after] - (numbered[after] - at)
        backwards[(backwards <= np.where(before >= 0, rows[before], -1)) | (after == before)] = -1
        where = np.where(self._same(frames, forwards), forwards, -1)
        return np.where((where < 0) & self._same(frames, backwards), backwards, where)

    def _same(self, frames: Frames, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        inside = (rows >= 0) & (rows < len(self.passed))
        there = self.passed[np.where(inside, rows, 0)]
        same = (there["can_id"] == frames.can_id) & (there["length"] == frames.length)
        alike: NDArray[np.bool_] = inside & same & (there["data"] == frames.data[:, :8]).all(1)
        return alike


def life_accounts(
    bus: Bus, places: Places, lives: list[Life], events: list[Event], sent: list[list[Frames]]
) -> list[LifeAccount]:
    """Return what became of the frames of each process; ``sent``, of each, are the frames in its logs."""
    heard = bus.all_heard()
    ends = [*(life.first for life in lives[1:]), len(places.passed)]
    till_us = [*(round(1e6 * life.began_s) for life in lives[1:]), 1 << 62]
    downs = [event for event in events if event.name == "interface down and up"]
    accounts = []
    for life, end, until_us, own in zip(lives, ends, till_us, sent, strict=True):
        taken = places.taken[life.first : end]
        logged = np.flatnonzero(taken)
        account = LifeAccount(life, life.fetched, len(logged))
        if life.summary is not None:
            account.fetched = life.summary["frames"]
            account.dropped = life.summary["log"]["dropped"]
        if len(logged):
            gaps = life.first + np.flatnonzero(~taken[logged[0] : logged[-1]]) + logged[0]
            account.between = len(gaps)
            account.explained = int(sum(_near(bus, gaps, down) for down in downs))
        account.missing = _missing(bus, account, life.first + (int(logged[-1]) + 1 if len(logged) else 0), end)
        inside = (heard["mono_us"] >= round(1e6 * life.began_s)) & (heard["mono_us"] < until_us)
        _compare_sent(account, heard[inside], Frames.concatenate(own))
        accounts.append(account)
    return accounts


def _near(bus: Bus, gaps: NDArray[np.int64], down: Event) -> int:
    first, last = np.searchsorted(gaps, [down.first - 4000, down.last + 4000])
    return int(last - first)


def _missing(bus: Bus, account: LifeAccount, next_row: int, end: int) -> int:
    """Return how many received frames are in no log, and note for how long they were there."""
    life = account.life
    if account.fetched is not None:
        missing = account.fetched - account.logged
        since_s = life.fetched_s(account.logged)
    else:  # those behind the last one that were sent before the end: a bound
        missing = max(min(bus.passed_at(life.ended_s), end) - next_row, 0)
        since_s = bus.time_of(next_row)
    if life.ending == "SIGKILL":
        account.lost_ms = 1e3 * (life.ended_s - (since_s or life.began_s)) if missing > 0 else 0.0
    return missing


def _compare_sent(account: LifeAccount, heard: NDArray[np.void], logged: Frames) -> None:
    """Go through what was heard and what is logged as sent, both in order, and count what only one of them has."""
    account.heard = len(heard)
    on_bus, in_log = _words(heard["can_id"], heard["data"]), _words(logged.can_id, logged.data)
    only_heard, only_logged = _unmatched(on_bus, in_log)
    account.unlogged, account.unheard = len(only_heard), len(only_logged)
    if len(only_heard):
        account.unlogged_ms = 1e3 * account.life.ended_s - int(heard["mono_us"][only_heard[0]]) / 1e3


def _words(ids: NDArray[np.uint32], data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Return a word for each frame; equal frames have equal ones."""
    payload = np.ascontiguousarray(data[:, :8]).view("<u8").ravel()
    return payload * np.uint64(0x9E3779B97F4A7C15) + ids.astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)


def _unmatched(left: NDArray[np.uint64], right: NDArray[np.uint64]) -> tuple[list[int], list[int]]:
    """Return the places of what is only in the one of two sequences, and of what is only in the other.

    Where they part, they meet again where the next `ALIKE` of both are equal.
    """
    lefts, rights = _runs(left), _runs(right)
    only_left: list[int] = []
    only_right: list[int] = []
    i = j = 0
    while i < len(left) and j < len(right):
        n = min(len(left) - i, len(right) - j)
        parts = np.flatnonzero(left[i : i + n] != right[j : j + n])
        same = int(parts[0]) if len(parts) else n
        i, j = i + same, j + same
        if same == n:
            break
        ahead = np.flatnonzero(np.isin(rights[j:], lefts[i:]))
        if not len(ahead):
            break
        again = j + int(ahead[0])
        only_right += range(j, again)
        found = i + int(np.flatnonzero(lefts[i:] == rights[again])[0])
        only_left += range(i, found)
        i, j = found, again
    return [*only_left, *range(i, len(left))], [*only_right, *range(j, len(right))]


def _runs(words: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return a word for each `ALIKE` words in a row."""
    count = max(len(words) - ALIKE + 1, 0)
    runs = np.zeros(count, np.uint64)
    for n in range(ALIKE):
        runs = runs * np.uint64(0x100000001B3) + words[n : n + count]
    return runs


def received_and_sent(frames: Frames) -> tuple[Frames, Frames]:
    sent = (frames.flags & FrameFlag.SENT) != 0
    return frames[~sent], frames[sent]


def log_again(bus: Bus, places: Places, events: list[Event]) -> list[float | None]:
    """Return, for each event, when the first frame that passed after it and is in a log was there."""
    rows = np.flatnonzero(places.taken)
    answers: list[float | None] = []
    for event in events:
        at = int(np.searchsorted(rows, event.last))
        answers.append(max(bus.time_of(int(rows[at])) - event.ended_s, 0.0) if at < len(rows) else None)
    return answers
