"""The runs of a study in several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from pathlib import Path
from typing import Protocol

from dctorque_can.errors import DctorqueError
from dctorque_can.study.draw import draw
from dctorque_can.study.plan import Study
from dctorque_can.study.results import Results
from dctorque_can.study.run import Record, Setup


class Maker(Protocol):
    """Makes the runs of a study; what run k gives depends on k and the values of its factors only."""

    def warm_up(self) -> None:
        """Compile everything, or load it where it is compiled already."""

    def run(self, number: int, values: Mapping[str, float]) -> Record:
        """Return one line of results."""
        ...


class Given(Protocol):
    """What every process of a study is given; it can be pickled."""

    def bench(self) -> Maker:
        """Return what makes the runs."""
        ...


_bench: Maker | None = None  # of a worker process


def available_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


def missing_runs(study: Study, results: Results) -> dict[int, dict[str, float]]:
    """Return the values of the factors of the runs that are not there yet, by number of the run."""
    return {number: values for number, values in enumerate(draw(study)) if number not in results.records}


def make_runs(
    study: Study,
    results: Results,
    missing: Mapping[int, Mapping[str, float]],
    jobs: int | None,
    drives: Path | None,
    progress: Callable[[float], None] = lambda fraction: None,
) -> None:
    """Make the ``missing`` runs and keep each in ``results`` as it finishes.

    Args:
        study: that they belong to.
        results: of its other runs.
        missing: see `missing_runs`.
        jobs: processes; None for one per core.
        drives: keeps the simulated drives there, or None.
        progress: is told the finished share of the whole study.

    Raises:
        DctorqueError: the car with nothing varied fails, or a worker was ended from outside.
    """
    total = study.plan.runs + 1

    def check(record: Record) -> None:
        if record["run"] == 0 and "error" in record:
            raise DctorqueError(f"{study.path}: the car with nothing varied fails already: {record['error']}")

    keep_runs(Setup.of(study, drives), results, missing, total, jobs, progress, check)


def keep_runs(
    setup: Given,
    results: Results,
    missing: Mapping[int, Mapping[str, float]],
    total: int,
    jobs: int | None,
    progress: Callable[[float], None] = lambda fraction: None,
    check: Callable[[Record], None] = lambda record: None,
) -> None:
    """Make the ``missing`` runs of ``total`` and keep each that ``check`` lets pass; see `make_runs`."""
    progress(1.0 - len(missing) / total)
    for record in finished_runs(setup, missing, jobs or available_cores()):
        check(record)
        results.append(record)
        progress(len(results.records) / total)


def finished_runs(setup: Given, values: Mapping[int, Mapping[str, float]], jobs: int) -> Iterator[Record]:
    """Yield the record of every run, in the order in which they finish.

    Compiled code is made here, before any worker starts: they find it in the cache. When the caller stops taking
    records (an interrupt, an error), workers are ended at once.

    Args:
        setup: of the study.
        values: of the factors, by number of the run.
        jobs: processes; with one the runs are made in this process.

    Raises:
        DctorqueError: a worker was ended from outside.
    """
    bench = setup.bench()
    bench.warm_up()
    jobs = min(jobs, len(values))
    if jobs <= 1:
        for number, factors in values.items():
            yield bench.run(number, factors)
        return
    # Matrices of a filter are small: threads of its linear algebra would only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    others = set(multiprocessing.active_children())
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin, initargs=(setup,))
    futures: list[Future[Record]] = []
    try:
        # Ctrl-C reaches every process of a terminal: workers inherit that it is blocked, and this one decides.
        _with_interrupt_blocked(lambda: futures.extend(pool.submit(_run, *item) for item in values.items()))
        for future in as_completed(futures):
            yield future.result()
    except BrokenProcessPool as error:
        raise DctorqueError(
            "a worker process was ended (out of memory?); what had finished is kept, and the same command goes on"
        ) from error
    finally:
        if not all(future.done() for future in futures):
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
        pool.shutdown(cancel_futures=True)


def _with_interrupt_blocked(start: Callable[[], None]) -> None:
    old = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, old)


def _begin(setup: Given) -> None:
    """Prepare a worker process; it ends when its parent has ended in whatever way."""
    global _bench
    parent = multiprocessing.parent_process()
    assert parent is not None
    sentinel = parent.sentinel

    def follow() -> None:
        wait([sentinel])
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
    _bench = setup.bench()


def _run(number: int, values: Mapping[str, float]) -> Record:
    assert _bench is not None
    return _bench.run(number, values)
