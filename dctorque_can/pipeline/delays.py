"""Samples in the order in which they were taken: what the loop does when the age of some signals is known.

The frame of a signal with a delay tells of an earlier time. Its sample waits in a queue, ordered by the time at
which it was taken, until no older one can come any more; only then it takes effect for good. An estimate stands on
a copy of that state, in which all that waits has taken effect too and which was carried on to the present: so each
sample acts exactly once, at its own time, and none is left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled_without_allocation
from dctorque_can.pipeline.parts import Parts
from dctorque_can.pipeline.samples import N_QUANTITIES

MOST = 1024  # frames that may wait: 0.2 s of 5000 frames/s
PLACES = MOST + N_QUANTITIES  # and the one at hand, whose signals may be of different times

SAMPLES = np.dtype(
    [
        ("t_us", "i8"),  # when they were taken
        ("frame", "i8"),  # by which they came
        ("there", "u1", (N_QUANTITIES,)),
        ("value", "f8", (N_QUANTITIES,)),
    ],
    align=True,
)
"""What one frame says of one time."""

QUEUE = np.dtype(
    [
        ("frame_us", "i8"),  # time of the frame at hand
        ("frame", "i8"),  # its number
        ("first", "i8"),  # place of the oldest that waits
        ("count", "i8"),
        ("stale", "u1", (N_QUANTITIES,)),  # inputs that were missing in the last estimate
        ("waiting", SAMPLES, (PLACES,)),  # in a ring
    ],
    align=True,
)
"""What waits, the oldest first."""


def new() -> NDArray[np.void]:
    """Return an empty `QUEUE` ``[1]``."""
    return np.zeros(1, QUEUE)


@compiled_without_allocation
def note_frame(queue: Any, t_us: int) -> None:
    """Note the time of a new frame."""
    queue.frame_us = t_us
    queue.frame += 1


@compiled_without_allocation
def place(queue: Any, t_us: int) -> Any:
    """Return what the frame at hand says of a time, among all that waits; there must be room.

    It comes after all that were taken at the same time.
    """
    n = queue.count
    while n > 0 and queue.waiting[(queue.first + n - 1) % PLACES].t_us > t_us:
        n -= 1
    at = (queue.first + n - 1) % PLACES
    if n == 0 or queue.waiting[at].t_us != t_us or queue.waiting[at].frame != queue.frame:
        for m in range(queue.count, n, -1):
            move(queue.waiting[(queue.first + m - 1) % PLACES], queue.waiting[(queue.first + m) % PLACES])
        queue.count += 1
        at = (queue.first + n) % PLACES
        samples = queue.waiting[at]
        samples.t_us, samples.frame = t_us, queue.frame
        for q in range(N_QUANTITIES):
            samples.there[q] = False
    return queue.waiting[at]


@compiled_without_allocation
def count_timeouts(queue: Any, inputs: Any, health: Any) -> None:
    """Count the inputs that are missing in an estimate and were not in the last one."""
    for q in range(N_QUANTITIES):
        if inputs.stale[q] and not queue.stale[q]:
            health.timeouts[q] += 1
        queue.stale[q] = inputs.stale[q]


@compiled_without_allocation
def move(source: Any, target: Any) -> None:
    """Copy one `SAMPLES`."""
    target.t_us, target.frame = source.t_us, source.frame
    for q in range(N_QUANTITIES):
        target.there[q] = source.there[q]
        target.value[q] = source.value[q]


@compiled_without_allocation
def nth(queue: Any, n: int) -> int:
    """Return the place of the n-th of those that wait, the oldest first."""
    return int((queue.first + n) % PLACES)


@compiled_without_allocation
def is_ripe(queue: Any, arrived_us: int, longest_delay_us: int) -> bool:
    """Return whether the oldest that waits can take effect for good: none older can come, or no room is left."""
    if queue.count == 0:
        return False
    if longest_delay_us == 0 or queue.count > MOST:
        return True
    return bool(queue.waiting[queue.first].t_us < arrived_us - longest_delay_us)


@compiled_without_allocation
def take_oldest(queue: Any) -> int:
    """Take the oldest out; return its place, where it stands until another one comes."""
    place = int(queue.first)
    queue.first = (place + 1) % PLACES
    queue.count -= 1
    return place


@compiled_without_allocation
def copy(source: Parts, target: Parts) -> None:
    """Make one estimator's state that of another; tapes stay."""
    for i in range(len(source.memory)):
        target.memory[i] = source.memory[i]
