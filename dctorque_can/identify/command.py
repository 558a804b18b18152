"""From recordings to a vehicle file that fits them: everything, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dctorque_can.config.load import Config, load_documents
from dctorque_can.errors import DctorqueError
from dctorque_can.evidence.moments import moments
from dctorque_can.evidence.series import decoded, read_frames
from dctorque_can.evidence.yaml_edits import Edit
from dctorque_can.identify import resistances
from dctorque_can.identify.beliefs import seen_by
from dctorque_can.identify.drive import Drive
from dctorque_can.identify.identification import solution
from dctorque_can.identify.identified_file import changes, identified_text
from dctorque_can.identify.judgement import (
    Judgement,
    Sensitivity,
    held_out,
    judged,
    noise_results,
    sensitivities,
    without_help,
)
from dctorque_can.identify.kissing_points import kissing_points
from dctorque_can.identify.manoeuvres import Missing, missing
from dctorque_can.identify.plan import lacking
from dctorque_can.identify.results import Result, common, correlations, results
from dctorque_can.identify.unknowns import GROUPS
from dctorque_can.logs.reader import open_log
from dctorque_can.pipeline.frames import Frames

_READ, _SOLVED = 0.3, 0.8  # shares of the work that are done then


@dataclass(frozen=True)
class Identified:
    """What recordings say of a vehicle file.

    Attributes:
        results: each number before and after.
        edits: what changes in the file.
        output: that was written, or None.
        common: how sure delays and ratios are together and against each other, see `results.common`.
        correlations: what the recordings cannot tell apart: two names and the correlation of their errors.
        before: what the estimator makes of what was held out, with the file as it was.
        after: … and as it is now.
        sensitivities: what is left unknown of each number does to the torques.
        likelihood: growth of the logarithm of the likelihood of what was held out, by the kind of equation.
        equations: by their kind, how many were fitted and held out.
        missing: manoeuvres that the recordings lack for what stayed unknown.
        unclear: keys of what stayed unknown although the recordings hold what could tell of it.
        problems: what could not be read.
    """

    results: list[Result]
    edits: list[Edit]
    output: Path | None
    common: dict[str, tuple[float, float]]
    correlations: list[tuple[str, str, float]]
    before: Judgement
    after: Judgement
    sensitivities: list[Sensitivity]
    likelihood: dict[str, float]
    equations: dict[str, tuple[int, int]]
    missing: list[Missing]
    unclear: list[str]
    problems: list[str]

    def as_json(self) -> dict[str, Any]:
        """Return the result for scripts."""
        numbers = [
            {
                "key": each.key,
                "group": each.group,
                "unit": each.unit,
                "before": each.before.value,
                "before_sigma": each.before.sigma,
                "value": each.after.value,
                "sigma": each.after.sigma,
                "told": each.told,
                "refused": each.refused,
                "changed": each.changes,
            }
            for each in self.results
        ]
        return {
            "numbers": numbers,
            "output": None if self.output is None else str(self.output),
            "common": {group: {"together": a, "apart": b} for group, (a, b) in self.common.items()},
            "correlations": [{"first": a, "second": b, "correlation": c} for a, b, c in self.correlations],
            "before": asdict(self.before),
            "after": asdict(self.after),
            "sensitivities": [asdict(each) for each in self.sensitivities],
            "held_out_likelihood_growth": self.likelihood,
            "equations": {kind: {"fitted": a, "held_out": b} for kind, (a, b) in self.equations.items()},
            "lacking": lacking(self.results),
            "missing": [asdict(each) for each in self.missing],
            "unclear": self.unclear,
            "problems": self.problems,
        }


def identify_logs(
    config: Config,
    logs: Sequence[Path],
    groups: Sequence[str] = GROUPS,
    output: Path | None = None,
    force: bool = False,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Identified:
    """Return what logs say of a vehicle file, and write the file with it.

    Args:
        config: of the file.
        logs: recordings of drives.
        groups: of `GROUPS`, to be looked for.
        output: the file to be written, or None.
        force: whether an existing one is overwritten.
        progress: is told the share of the work that is done.

    Raises:
        DctorqueError: a log cannot be read or says nothing of the car, or the file cannot be written.
    """
    if output is not None:
        _refuse(output, config, force)
    frames: list[Frames] = []
    problems: list[str] = []
    for n, path in enumerate(logs):
        with ExitStack() as stack:
            reader = stack.enter_context(open_log(path))
            parts = read_frames([reader], config, _part(progress, n, len(logs)))
            problems += reader.problems
        frames.append(Frames.concatenate(parts) if parts else Frames.empty())
    recordings = [decoded([each], config) for each in frames]
    for path, series in zip(logs, recordings, strict=True):
        if not series.signals:
            raise DctorqueError(f"{path}: holds no usable value of any mapped signal; is it a log of this car?")
    solved = solution(recordings, config, groups, lambda done: progress(_READ + (_SOLVED - _READ) * done))
    if not any(fitted for kind, (fitted, _) in solved.equations.items() if kind != "wheels"):
        raise DctorqueError(
            f"{', '.join(map(str, logs))}: no equation of motion holds anywhere: it takes a clutch that is locked "
            "for a second while the car rolls; `check --log` says what is wrong with the signals"
        )
    found = results(solved, config)
    changed = _with(config, found)
    drives = resistances.drives([moments(seen_by(series, changed)) for series in recordings], changed)
    found += _beyond(drives, changed, groups)
    rest = [stretch for each in frames for stretch in held_out(each)]
    before_judged, after_judged = judged(rest, config), judged(rest, _with(config, found))
    if "noises" in groups:
        noises = noise_results(after_judged)
        if any(each.changes for each in noises):
            noises = without_help(noises, after_judged, judged(rest, _with(config, [*found, *noises])))
            after_judged = judged(rest, _with(config, [*found, *noises]))
        found += noises
    edits = changes(config, found)
    lacks, unclear = missing(drives, config, found)
    progress(0.5 * (1.0 + _SOLVED))
    sensitive = sensitivities(rest[0], config, edits, found) if rest else []
    if output is not None:
        try:
            output.write_text(identified_text(config, edits), encoding="utf-8")
        except OSError as error:
            raise DctorqueError(f"{output}: cannot be written: {error.strerror}") from error
    progress(1.0)
    return Identified(
        results=found,
        edits=edits,
        output=output,
        common=common(solved),
        correlations=correlations(solved, config),
        before=before_judged,
        after=after_judged,
        sensitivities=sensitive,
        likelihood={kind: after - before for kind, (before, after) in solved.likelihood.items()},
        equations=solved.equations,
        missing=lacks,
        unclear=unclear,
        problems=problems,
    )


def _with(config: Config, found: Sequence[Result]) -> Config:
    """Return a vehicle file with what was found."""
    return load_documents(config.documents, {edit.key: edit.value for edit in changes(config, found)})


def _beyond(drives: Sequence[Drive], config: Config, groups: Sequence[str]) -> list[Result]:
    """Return what recordings tell with all that the equations of motion together have found.

    Args:
        drives: recordings.
        config: with what was found.
        groups: that are looked for.
    """
    found = []
    if "spin" in groups:
        found += resistances.spin_losses(drives, config)
    if "road" in groups:
        found += resistances.road_load(drives, _with(config, found))
    if "kissing_points" in groups:
        found += kissing_points([drive.m for drive in drives], config)
    return found


def _part(progress: Callable[[float], None], n: int, logs: int) -> Callable[[float], None]:
    """Return what is told the share of log n that has been read."""
    return lambda done: progress(_READ * (n + done) / logs)


def _refuse(output: Path, config: Config, force: bool) -> None:
    if output.resolve() == config.path.resolve():
        raise DctorqueError(f"{output}: is the vehicle file itself, which stays as it is: name another file")
    if output.exists() and not force:
        raise DctorqueError(f"{output}: exists already: name another file, or add --force")
