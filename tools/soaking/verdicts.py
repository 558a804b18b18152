"""What must hold after a run, and whether it does."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .account import Account, LifeAccount
from .bus import MINDED_LATE_S
from .replayed import LogResult
from .run import KILLED_WRITER, RECOVERY_S, Run
from .service import Sample

HANDED_OVER_MS = 50.0  # of the service alone, docs/operations.md
NEW_WRITER_S = 10.0  # at most, until a new log process has confirmed something
WARM_UP_S = 300.0  # in which each kind of fault comes for the first time
JUDGED_S = 1200.0
MOST_MB_PER_HOUR = 1.0
CODES = (0, 3)
NOT_FETCHED = "were not fetched in time and lost"


@dataclass(frozen=True)
class Verdict:
    """One invariant: whether it holds (None: not judged), and the figures."""

    name: str
    holds: bool | None
    text: str


def verdicts(run: Run, account: Account, logs: list[LogResult], left_open: int, flush_ms: float) -> list[Verdict]:
    """Return all verdicts."""
    return [
        _no_crash(run),
        _finite(logs),
        _in_a_log(run, account),
        _intact(account),
        _kills(run, account, flush_ms),
        _replays(logs, left_open),
        _published(run, account, logs),
        _memory(run),
        _files(run),
        _recovered(run, account),
    ]


def _no_crash(run: Run) -> Verdict:
    wrong = list(run.crashes)
    for life in run.service.lives:
        if life.ending == "SIGTERM" and life.code not in CODES:
            wrong.append(f"process {life.number} ended with code {life.code}")
        wrong += [f"process {life.number}: {line}" for line in life.was_told("Traceback", "Error:", "Exception")]
    ends = [life.ending or "by itself" for life in run.service.lives]
    counts = ", ".join(f"{ends.count(ending)} × {ending}" for ending in sorted(set(ends)))
    return Verdict("no crash", not wrong, "; ".join([f"{len(ends)} processes: {counts}", *wrong]))


def _finite(logs: list[LogResult]) -> Verdict:
    estimates, bad = sum(log.estimates for log in logs), sum(log.not_finite for log in logs)
    return Verdict("every estimate is a number", bad == 0, f"{estimates} estimates, {bad} numbers are none")


def _in_a_log(run: Run, account: Account) -> Verdict:
    """Every received frame is in a log or counted: of the processes that ended in order, which alone can count."""
    wrong = []
    received = logged = dropped = 0
    for life in account.lives:
        if life.life.summary is None:
            continue
        received += life.fetched or 0
        logged += life.logged
        dropped += min(max(life.missing, 0), life.dropped)
        if not 0 <= life.missing <= life.dropped:
            wrong.append(f"process {life.life.number}: {life.missing} are missing, {life.dropped} counted")
    text = f"{received} received by processes that ended in order: {logged} in a log, {dropped} counted"
    for life in account.lives:
        between = life.between - life.explained
        at_drop = life.dropped if life.life.summary is not None else 0
        if life.life.fetched is None and between > at_drop and not life.life.was_told(NOT_FETCHED):
            wrong.append(f"process {life.life.number}: {between} missing in the middle, nothing told")
    untaken = run.bus.untaken
    lost = sum(life.between for life in account.lives)
    text += f"; {account.passed} passed on the bus, {lost} of them between logged ones in no log"
    text += f"; {untaken} more that nobody was there for"
    return Verdict("every received frame is in a log or counted", not wrong, "; ".join([text, *wrong]))


def _intact(account: Account) -> Verdict:
    good = account.altered == 0 and account.twice == 0
    logged = sum(life.logged for life in account.lives)
    text = f"{logged} compared to what was sent: {account.altered} altered, {account.twice} twice or out of order"
    return Verdict("every frame once, as it was, in order", good, text)


def _kills(run: Run, account: Account, flush_ms: float) -> Verdict:
    wrong, texts = [], []
    for name, limit_ms in (("the service", HANDED_OVER_MS), ("everything", flush_ms)):
        killed = [life for life in account.lives if life.life.killed == name]
        lost = [(life, life.lost_ms or 0.0) for life in killed if not _without_writer_ms(run, life)]
        for life, lost_ms in lost:
            late_s = run.bus.longest_late_s(life.life.ended_s - 1.0, life.life.ended_s + 0.1)
            late_ms = 1e3 * max(late_s, MINDED_LATE_S)
            if lost_ms > limit_ms + late_ms:
                wrong.append(f"process {life.life.number}: {lost_ms:.0f} ms, beside a loop {late_ms:.0f} ms late")
        for life in killed:
            without_ms = _without_writer_ms(run, life)
            if without_ms:
                texts.append(f"{name}, {without_ms:.0f} ms after the log process: lost {life.missing} frames")
        if lost:
            times = sorted(lost_ms for _, lost_ms in lost)
            frames = max(life.missing for life, _ in lost)
            texts.append(
                f"{name}: {len(lost)} times, lost at most {times[-1]:.0f} ms ({frames} frames), "
                f"median {times[len(times) // 2]:.0f} ms, {limit_ms:g} ms allowed"
            )
    if not texts:
        return Verdict("kill -9 loses no more than is said", None, "no process was killed")
    return Verdict("kill -9 loses no more than is said", not wrong, "; ".join(texts + wrong))


def _without_writer_ms(run: Run, life: LifeAccount) -> float:
    """Return how long before the end of a process its log process was killed, 0 for longer than `NEW_WRITER_S`."""
    since = [
        life.life.ended_s - event.ended_s
        for event in run.events
        if event.name == KILLED_WRITER and event.life == life.life.number
    ]
    return 1e3 * min((seconds for seconds in since if 0 <= seconds < NEW_WRITER_S), default=0.0)


def _replays(logs: list[LogResult], left_open: int) -> Verdict:
    wrong = [f"{log.path.name}: {problem}" for log in logs for problem in log.problems]
    wrong += [f"{log.path.name}: {log.different} of {log.estimates} rows differ" for log in logs if log.different]
    estimates = sum(log.estimates for log in logs)
    text = f"{len(logs)} logs, {estimates} estimates; {left_open} were still torn at the end and closed then"
    return Verdict("each log replays alone, bit for bit", not wrong, "; ".join([text, *wrong]))


def _published(run: Run, account: Account, logs: list[LogResult]) -> Verdict:
    wrong = [f"{log.path.name}: {log.unlike} of {log.sent} are no estimate" for log in logs if log.unlike]
    downs = [event.life for event in run.events if event.name == "interface down and up"]
    heard = unlogged = unheard = 0
    for life in account.lives:
        heard, unlogged, unheard = heard + life.heard, unlogged + life.unlogged, unheard + life.unheard
        under_way = int(life.life.ending == "SIGKILL")  # one frame may be, between the loop and the sending thread
        if life.unheard > under_way and life.life.number not in downs:
            wrong.append(f"process {life.life.number}: {life.unheard} logged as sent were not heard")
        if life.unlogged > life.dropped and life.life.ending != "SIGKILL":
            wrong.append(f"process {life.life.number}: {life.unlogged} were heard and are not logged")
    sent = sum(log.sent for log in logs)
    text = (
        f"{heard} frames heard; {sent} logged as sent, each compared to its estimate; {unlogged} heard and not "
        f"logged (kills, drops); {unheard} logged and not heard (interface down, kills)"
    )
    return Verdict("what was published is what the logs say", not wrong, "; ".join([text, *wrong]))


def _long_runs(run: Run) -> dict[str, list[Sample]]:
    """Return the samples of the process of each role that lived longest, without its first time."""
    by_process: dict[tuple[str, int], list[Sample]] = {}
    for sample in run.service.samples:
        by_process.setdefault((sample.role, sample.pid), []).append(sample)
    longest: dict[str, list[Sample]] = {}
    for (role, _), samples in by_process.items():
        warm = [sample for sample in samples if sample.at_s > samples[0].at_s + WARM_UP_S]
        if warm and _length_s(warm) > _length_s(longest.get(role, [])):
            longest[role] = warm
    return longest


def _length_s(samples: list[Sample]) -> float:
    return samples[-1].at_s - samples[0].at_s if samples else 0.0


def slope_mb_per_hour(samples: list[Sample]) -> tuple[float, float]:
    """Return the slope of the memory by least squares, and its standard error."""
    hours = np.array([sample.at_s for sample in samples]) / 3600
    memory = np.array([sample.own_kb for sample in samples]) / 1024
    hours -= hours.mean()
    spread = float((hours**2).sum())
    slope = float((hours * memory).sum()) / spread
    rest = memory - memory.mean() - slope * hours
    return slope, math.sqrt(float((rest**2).sum()) / max(len(rest) - 2, 1) / spread)


def _memory(run: Run) -> Verdict:
    texts, holds = [], None
    for role, samples in _long_runs(run).items():
        if _length_s(samples) < JUDGED_S:
            continue
        slope, error = slope_mb_per_hour(samples)
        holds = (holds is not False) and slope < MOST_MB_PER_HOUR
        first, last = samples[0].own_kb / 1024, samples[-1].own_kb / 1024
        texts.append(
            f"{role}: {slope:+.2f} ± {error:.2f} MB/h over {_length_s(samples) / 60:.0f} min, "
            f"{first:.0f} → {last:.0f} MB"
        )
    return Verdict("memory is flat", holds, "; ".join(texts) or _too_short())


def _files(run: Run) -> Verdict:
    texts, holds = [], None
    for role, samples in _long_runs(run).items():
        if _length_s(samples) < JUDGED_S:
            continue
        counts = [sample.files for sample in samples]
        third = len(counts) // 3
        early, late = (int(np.median(part)) for part in (counts[:third], counts[-third:]))
        holds = (holds is not False) and late <= early
        texts.append(f"{role}: {early} → {late}, at most {max(counts)}")
    return Verdict("descriptors are flat", holds, "; ".join(texts) or _too_short())


def _too_short() -> str:
    return f"no process lived for {(WARM_UP_S + JUDGED_S) / 60:.0f} min"


def _recovered(run: Run, account: Account) -> Verdict:
    wrong = [
        f"{event.name} at {event.began_s - run.events[0].began_s:.0f} s"
        for event, log_s in zip(run.events, account.log_again_s, strict=True)
        if event.valid_after_s is None or log_s is None
    ]
    slowest = max((event.valid_after_s or RECOVERY_S for event in run.events), default=0.0)
    text = f"{len(run.events)} faults; valid torques on the bus again after {slowest:.1f} s at most"
    return Verdict("every fault is recovered from", not wrong, "; ".join([text, *wrong]))
