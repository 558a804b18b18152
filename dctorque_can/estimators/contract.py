"""What an estimator gets from a frame and what it must answer.

An estimator is a package of its own: a named tuple of arrays, whose first field ``state`` is a record ``[1]`` of
all that changes in it, and seven compiled functions that `implement` joins to the tuple's type. The pipeline
knows no more of it. It calls the functions below; the compiler chooses by the type of the tuple, so that only the
chosen estimator is compiled, and nothing is decided at run time.

Each frame: `advance` to its time, then `act` on its values; `conclude` for each estimate that is published. A
field ``tape`` of the state, which must be its last, is room for the smoother and no part of what a snapshot keeps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from dctorque_can.pipeline.samples import N_QUANTITIES

F = TypeVar("F", bound=Callable[..., Any])

INPUTS = np.dtype(
    [
        # what a vehicle file says of the inputs
        ("mapped", "u1", (N_QUANTITIES,)),
        ("delay_us", "i8", (N_QUANTITIES,)),
        ("driven_axle", "i8"),  # DrivenAxle
        ("infer_gears", "u1"),
        ("one_gear", "u1"),  # one gear signal for the whole gearbox
        ("phases_told", "u1"),  # something says of each clutch whether it is open
        ("phases_believed", "u1"),  # … and the speeds do not contradict it
        ("magnitudes", "u1"),  # some speed of wheels or shafts is, or may be, told without its sign
        ("step_us", "i8"),  # of an estimator that goes on in steps of a grid
        ("torque_limit", "f8", (2,)),  # N·m, beyond which a clutch torque is not plausible
        ("output_limit", "f8"),
        # what the frames have said so far
        ("t_us", "i8"),  # the present; NEVER before the first sample
        ("origin_us", "i8"),  # where the grid and all periods begin, so that only differences of time matter
        ("value", "f8", (N_QUANTITIES,)),
        ("signs", "u1", (N_QUANTITIES,)),  # of speeds: `samples.Signs`
        ("direction", "i8"),  # of the car: 1 forwards, −1 backwards, 0 not known
        ("heading", "i8"),  # … that the signs of the values stand on: ±1
        ("doubt", "f8"),  # … and the probability that it is the other one
        ("seen_us", "i8", (N_QUANTITIES,)),
        ("available", "u1", (N_QUANTITIES,)),
        ("stale", "u1", (N_QUANTITIES,)),
        ("fresh", "u1", (N_QUANTITIES,)),  # renewed by the frame at hand
        ("gear", "i8", (2,)),
        ("gear_known", "u1", (2,)),
        # of one gear for the whole gearbox:
        ("gear_unsure", "u1", (2,)),  # the shaft does not drive, and nobody says that its gear is in
        ("synchronises", "u1", (2,)),  # … so that a synchroniser may be at work
        ("idle", "u1", (2,)),  # nothing says that this clutch is open, but the other one drives and does not slip
        ("ambiguous", "u1"),  # a clutch may carry torque on a shaft of which nobody says in which gear
        ("called", "i8", (2,)),  # whether the bus calls the clutch closed, 1, or open, 0; −1: it says nothing
        ("closed", "u1", (2,)),  # the clutch may carry torque
        ("closed_known", "u1", (2,)),
        ("touches", "f8", (2,)),  # 0 … 1, how near the position of an open clutch is to where it may not be open
        ("phase", "u1", (2,)),  # ClutchPhase
        ("w_c", "f8", (2,)),  # rad/s, shaft speeds as the frame at hand tells them, else as the estimator has them
        ("fits", "u1"),  # shaft speeds fit gears and wheels
        ("fits_again", "u1"),  # … and they did not for long, until this frame
    ],
    align=True,
)
"""What the bus says at a moment: values with their ages, and what was decided on them: gears, phases, …"""

BY_FILE = (
    *("mapped", "delay_us", "driven_axle", "infer_gears", "one_gear", "phases_told", "magnitudes", "step_us"),
    *("torque_limit", "output_limit"),
)
"""Fields of `INPUTS` that never change."""

ANSWER = np.dtype(
    [
        ("running", "u1"),  # estimates; else the torques are held as they were
        ("reset_us", "i8"),  # when it was last started
        ("T_c", "f8", (2,)),  # N·m, torques of both clutches
        ("slip", "f8", (2,)),  # rad/s, of what rubs in each; positive when the engine is faster
        ("w_e", "f8"),  # rad/s
        ("w_c", "f8", (2,)),
        ("wheels_late", "f8"),  # s, by which it has learned that wheels come later than told, against the shafts
        ("wheels_late_sigma", "f8"),  # … 0: it learns none
    ],
    align=True,
)
"""What an estimator says after every frame."""


class Functions(NamedTuple):
    """The compiled functions of an estimator, as described at those of the same name below."""

    start: Callable[..., None]
    stop: Callable[..., None]
    advance: Callable[..., None]
    act: Callable[..., None]
    conclude: Callable[..., int]
    is_finite: Callable[..., bool]
    report: Callable[..., None]


Limits = Mapping[str, tuple[int, int]]

_IMPLEMENTED: dict[type, Functions] = {}
_LIMITS: dict[type, Limits] = {}


def implement(kind: type, functions: Functions, limits: Limits | None = None) -> None:
    """Let the functions of this module be ``functions`` for estimators of the type ``kind``, a named tuple.

    Args:
        kind: the type.
        functions: that work on it.
        limits: least and largest value of the whole numbers in its state, by field, where `pipeline.bounds` cannot
            tell them by the name.
    """
    _IMPLEMENTED[kind] = functions
    _LIMITS[kind] = limits or {}


def limits_of(kind: type) -> Limits:
    """Return the limits that `implement` was given."""
    return _LIMITS[kind]


class _Chosen:
    """A function that compiled code can call: that of the same name of the estimator that it is called for."""

    def __init__(self, name: str) -> None:
        self._name = name

    def _of(self, args: Any) -> Any:
        return getattr(_IMPLEMENTED[args[0].instance_class], self._name)

    @property
    def _numba_type_(self) -> Any:
        from numba import types  # the compiler is loaded when it is needed

        return types.Dispatcher(cast(Any, self))

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Answer the compiler's question for the types of the result."""
        return self._of(args).get_call_template(args, kws)

    def get_overload(self, signature: Any) -> Any:
        """Answer the compiler's question for the machine code."""
        from numba.core import sigutils

        normalized: Callable[[Any], Any] = sigutils.normalize_signature
        return self._of(normalized(signature)[0]).get_overload(signature)


def _chosen_by_type(description: F) -> F:
    return cast(F, _Chosen(description.__name__))


@_chosen_by_type
def start(e: Any, answer: Any) -> None:
    """Become as new, with numbers that are finite, but do not run."""
    raise NotImplementedError


@_chosen_by_type
def stop(e: Any, answer: Any) -> None:
    """Hold the torques and expect nothing of the inputs: there was a gap in time, or a step back of the clock."""
    raise NotImplementedError


@_chosen_by_type
def advance(e: Any, inputs: Any, answer: Any, t_us: int) -> None:
    """Go on to ``t_us``, from ``inputs.t_us``, before the values of the frame at that time are known."""
    raise NotImplementedError


@_chosen_by_type
def act(e: Any, inputs: Any, answer: Any) -> None:
    """Let a whole frame take effect at ``inputs.t_us``, and answer."""
    raise NotImplementedError


@_chosen_by_type
def conclude(e: Any, inputs: Any, answer: Any, row: Any) -> int:
    """Fill torques, deviations and speeds of an estimate; return the `Status` bits that go with them.

    A torque is valid as far as the estimator knows; the pipeline judges inputs and limits. What the estimator
    does not know stays NaN.

    Args:
        e: the estimator.
        inputs: `INPUTS`.
        answer: `ANSWER`.
        row: `ESTIMATE` to be filled.
    """
    raise NotImplementedError


@_chosen_by_type
def is_finite(e: Any) -> bool:
    """Return whether all that is estimated is a number."""
    raise NotImplementedError


@_chosen_by_type
def report(e: Any, row: Any) -> None:
    """Fill what a `HEALTH` row says of the estimator itself."""
    raise NotImplementedError
