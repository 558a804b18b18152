"""What a recording measures of a vehicle file, cause by cause.

What stands first decides what can be measured next: a ratio needs the right shaft, a torque the right ratio. So
each step works on the file as it would be with all that was found before put right, and a mistake is told once,
where it is, and not by its consequences.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from dctorque_can.config.load import Config, ConfigError
from dctorque_can.evidence.clutch_verdicts import directions, kissing_points
from dctorque_can.evidence.delay_verdicts import late_signals
from dctorque_can.evidence.draft import Draft
from dctorque_can.evidence.findings import Finding
from dctorque_can.evidence.moments import WHEELS, Moments, moments
from dctorque_can.evidence.motion_verdicts import accelerations, brakes, brakes_untold, grades, told_direction
from dctorque_can.evidence.series import decoded
from dctorque_can.evidence.speed_verdicts import driven_axle, exchanged_shafts, scales, signs, units
from dctorque_can.evidence.torque_verdicts import offset, scale
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.samples import Quantity

_STEPS: tuple[Callable[[Moments, Draft], list[Finding]], ...] = (
    signs,
    brakes,
    exchanged_shafts,
    driven_axle,
    units,
    scales,
    directions,
    offset,
    scale,
    told_direction,
    brakes_untold,
    accelerations,
    grades,
    kissing_points,
    late_signals,
)
_ROUNDS = 3  # of one step: what it found may have hidden more


class Measured(NamedTuple):
    """What was measured.

    Attributes:
        findings: in the order of the steps.
        draft: the file with all that is certain put right.
    """

    findings: list[Finding]
    draft: Draft


def measure(frames: Sequence[Frames], config: Config) -> Measured:
    """Return what the frames of a drive contradict in a vehicle file.

    Args:
        frames: in order, of all mapped messages at least.
        config: the vehicle file.
    """
    draft = Draft(config)
    findings: list[Finding] = []
    m = moments(decoded(frames, draft.config, any_value=True))
    if not (m.has(Quantity.ENGINE_SPEED) and any(m.has(wheel) for wheel in WHEELS)):
        return Measured(findings, draft)
    for step in _STEPS:
        for _ in range(_ROUNDS):
            before = draft
            known = {each.key for each in findings}
            for found in step(m, draft):
                if found.key in known:
                    continue  # it was corrected as well as it can be
                draft, kept = _corrected(draft, found)
                findings.append(kept)
            if draft is before:
                break
            m = moments(decoded(frames, draft.config, any_value=True))
    return Measured(findings, draft)


def _corrected(draft: Draft, finding: Finding) -> tuple[Draft, Finding]:
    """Return a draft with a finding put right; without a correction where no such file can be."""
    if not finding.fix:
        return draft, finding
    try:
        return draft.corrected([*finding.fix, *finding.also]), finding
    except ConfigError:
        return draft, replace(finding, fix=(), also=())
