"""What recordings say of a vehicle file, in lines."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rich.markup import escape

from dctorque_can.report.traffic_lines import holds_no_frames, missing_lines, short_lines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dctorque_can.evidence.findings import Finding
    from dctorque_can.evidence.fixed_file import Fixed
    from dctorque_can.evidence.recording import Judged

CONTRADICTS = ("error", "warning")
"""Severities of findings that say that the file is wrong; a hint does not."""
_STYLES = {"error": "red", "warning": "yellow", "hint": "cyan"}


def finding_line(finding: Finding) -> str:
    """Return a finding in the colour of its severity, as markup."""
    style = _STYLES[finding.severity]
    return f"[{style}]{finding.severity}[/]: {escape(finding.key)}: {escape(finding.text)}"


def summary_line(file: str, judged: Judged) -> str:
    """Return how many findings there are, and what they stand on."""
    counts: Counter[str] = Counter(finding.severity for finding in judged.findings)
    parts = [f"{n} {name}{'s' if n > 1 else ''}" for name in _STYLES if (n := counts[name])]
    replay = judged.replay
    valid = f"{replay.valid_estimates} of {replay.estimates} estimates with valid clutch torques"
    return f"{file}: {', '.join(parts) or 'nothing'} found in {replay.bus_seconds:.0f} s of traffic; {valid}"


def fixed_lines(fixed: Fixed, left: Sequence[Finding]) -> list[str]:
    """Return what was corrected, and what the recordings say of the corrected file."""
    lines = [f"{fixed.path}: {edit.key}: {edit.value} ({edit.comment})" for edit in fixed.changes]
    lines += [f"{fixed.path}: left as it is: {finding.key}" for finding in fixed.left]
    told = sum(finding.severity in CONTRADICTS for finding in left)
    says = f"{told} more" if told else "nothing more"
    return [*lines, f"{fixed.path}: {len(fixed.changes)} values corrected; the same drive contradicts {says}"]


def incomplete_lines(judged: Judged) -> list[str]:
    """Return what of the recordings could not be read, or does not come as an estimator needs it."""
    replay = judged.replay
    lines = [
        *replay.problems,
        *(holds_no_frames(held.log, held.unread) for held in replay.logs if not held.frames),
    ]
    if replay.traffic.frames:
        lines += [*missing_lines(replay.traffic, replay.health), *short_lines(replay.traffic, lacking=True)]
    return lines
