"""The most likely numbers of a vehicle file, by recordings of ordinary drives.

Everything is normal and nearly linear: the equations of motion (`equations`) are solved with what was believed
(`regression`), set up anew with what was found, and solved again. Half of the equations, by minutes that
alternate, is never fitted: a number that makes what is fitted likelier and that less likely goes back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from dctorque_can.config.load import Config
from dctorque_can.evidence.moments import moments
from dctorque_can.evidence.series import Series
from dctorque_can.identify import equations as motion
from dctorque_can.identify.beliefs import Message, messages, seen_by
from dctorque_can.identify.common_delay import with_common_delay
from dctorque_can.identify.drive import Drive
from dctorque_can.identify.equations import Equations
from dctorque_can.identify.regression import Posterior, log_likelihood, solve
from dctorque_can.identify.unknowns import (
    GAIN,
    GROUPS,
    LAG,
    Unknown,
    believed,
    config_of,
    corrected,
    first_values,
    gain_belief,
    guess_of,
    late_name,
    unknowns,
)

ROUNDS = 5
_WORSE = 3.0  # logarithm of a likelihood: equations that are not quite right make as much of nothing
_CLEAR = 2.0  # standard deviations
_HUNDREDTH = 2.33  # standard deviations of a normal number, beyond which is one of a hundred
HELD_OUT_S = 60.0
"""One such stretch of a recording is fitted, the next one is held out, and so on."""


@dataclass(frozen=True, slots=True)
class Solution:
    """What was found of the unknowns.

    Attributes:
        unknowns: these.
        messages: whose delays are among them.
        values: by name, after the last round.
        posterior: of the last round: covariance of what is known.
        refused: names of those that went back to what was believed.
        likelihood: by the kind of equation, logarithm of the likelihood of what was held out, before and after.
        equations: by their kind, how many were fitted and held out.
    """

    unknowns: list[Unknown]
    messages: list[Message]
    values: dict[str, float]
    posterior: Posterior
    refused: list[str]
    likelihood: dict[str, tuple[float, float]]
    equations: dict[str, tuple[int, int]]


def solution(
    recordings: Sequence[Series],
    config: Config,
    groups: Sequence[str] = GROUPS,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Solution:
    """Return what recordings say of the numbers of a vehicle file.

    Args:
        recordings: of drives.
        config: the file.
        groups: of `GROUPS`; all other numbers are taken to be right.
        progress: is told the share of the work that is done.
    """
    known = messages(config)
    names = {quantity: late_name(each) for each in known for quantity in each.quantities}
    looked_for = unknowns(config, known, groups)
    values = first_values(config, looked_for, known)
    fitted: list[Equations] = []
    held: list[Equations] = []
    found: Posterior | None = None
    for n in range(ROUNDS):
        seen = config_of(config, values, known)
        fitted, held = [], []
        for series in recordings:
            drive = Drive.of(moments(seen_by(series, seen)), guess_of(config, values), names)
            for equation in motion.equations(drive):
                first, second = split(equation)
                fitted.append(first)
                held.append(second)
        found = solve(fitted, believed(looked_for, values))
        if n < ROUNDS - 1:
            values = corrected(looked_for, values, found)
        progress((n + 1) / ROUNDS)
    assert found is not None
    found = found.considering(GAIN, gain_belief(config).sigma)
    if "delays" in groups:
        found = _with_clear_lag(found, looked_for, values)
        found = with_common_delay(found, known, values)
    return _concluded(looked_for, known, values, found, fitted, held)


def _with_clear_lag(found: Posterior, looked_for: Sequence[Unknown], values: dict[str, float]) -> Posterior:
    """Return the posterior with the lag of the engine as it was believed, unless it is clearly another.

    A lag is never negative, so of one that is not there chance makes a positive one; and mostly there is none.
    """
    if LAG not in found.names:
        return found
    (prior,) = (each.prior for each in looked_for if each.name == LAG)
    now = found.of(LAG)
    change = prior.value - values[LAG]
    if abs(now.value - change) > _CLEAR * now.sigma:
        return found
    return replace(found, values=np.array(list(found.given(LAG, change).values())))


def split(equation: Equations) -> tuple[Equations, Equations]:
    """Return what is fitted and what is held out."""
    out = np.floor(equation.t_s / HELD_OUT_S) % 2 == 1
    return equation.at(~out), equation.at(out)


def overfits(
    name: str, before: float, found: Posterior, fitted: Sequence[Equations], held: Sequence[Equations]
) -> bool:
    """Return whether a number suits what was fitted and not what was held out.

    The others are the likeliest with and without it. A number that has moved by z of its standard deviations gains
    g = z²/2 where it was fitted, and g + √2 z ε elsewhere, with ε drawn anew: one of a hundred is below
    g − 4.66 √g.

    Args:
        name: of the number.
        before: what was believed of it.
        found: after regression.
        fitted, held: the equations.
    """
    after, without = dict(zip(found.names, found.values.tolist(), strict=True)), found.given(name, before)
    fits, holds = (
        log_likelihood(some, after, found) - log_likelihood(some, without, found) for some in (fitted, held)
    )
    return fits > 0.0 and holds < -max(_WORSE, 2.0 * _HUNDREDTH * sqrt(fits) - fits)


def _concluded(
    looked_for: list[Unknown],
    known: list[Message],
    values: dict[str, float],
    found: Posterior,
    fitted: Sequence[Equations],
    held: Sequence[Equations],
) -> Solution:
    """Return the solution; of each number decides what was held out (`overfits`).

    The equations of the last round are set up with ``values``; with these, all corrections are nought.
    """
    beliefs = believed(looked_for, values)
    before = {name: beliefs[name].value for name in found.names}
    after = {name: found.of(name).value for name in found.names}
    refused = [
        each.name
        for each in looked_for
        if each.name in found.names and each.group and overfits(each.name, before[each.name], found, fitted, held)
    ]
    kinds = dict.fromkeys(each.name for each in held)
    likelihood = {}
    for kind in kinds:
        mine = [each for each in held if each.name == kind]
        likelihood[kind] = (
            log_likelihood(mine, before, found),
            log_likelihood(mine, after, found),
        )
    counts = {
        kind: (
            sum(len(each) for each in fitted if each.name == kind),
            sum(len(each) for each in held if each.name == kind),
        )
        for kind in kinds
    }
    final = corrected(looked_for, values, found)
    for each in looked_for:
        if each.name in refused:
            final[each.name] = each.prior.value
    return Solution(looked_for, known, final, found, refused, likelihood, counts)
