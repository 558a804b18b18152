"""``dctorque study``: how robust the estimator is on a car that is not quite what it believes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.console import STDERR, STDOUT, activity, print_json, print_page, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import JsonOption, SetOption

if TYPE_CHECKING:
    from dctorque_can.study.catalogue import Catalogue
    from dctorque_can.study.catalogue_summary import CatalogueSummary
    from dctorque_can.study.plan import Study
    from dctorque_can.study.results import Results
    from dctorque_can.study.summary import StudySummary

_MOST_REASONS = 5


def study(
    file: Annotated[
        Path, typer.Argument(metavar="STUDY", help="Study (YAML), or the bare name of one that ships: paper_car.")
    ],
    settings: SetOption = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help="Takes results.jsonl, summary.json, sensitivity.png.  [default: out/study_NAME]",
            show_default=False,
        ),
    ] = None,
    runs: Annotated[
        int | None, typer.Option("--runs", min=1, help="Instead of the number in the file.", show_default=False)
    ] = None,
    vehicle: Annotated[
        str | None, typer.Option("--vehicle", help="Instead of the one in the file.", show_default=False)
    ] = None,
    drive: Annotated[
        Literal["paper", "mixed"] | None,
        typer.Option("--drive", help="Instead of the one in the file, and of its length.", show_default=False),
    ] = None,
    profile: Annotated[
        Literal["laboratory", "production", "inertial", "one_gear"] | None,
        typer.Option("--profile", help="Instead of the one in the file.", show_default=False),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option("--duration", metavar="SECONDS", help="Instead of the one in the file.", show_default=False),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Instead of the one in the file.", show_default=False)
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Of a catalogue: what smoothing makes of the estimates, too.")
    ] = False,
    drives: Annotated[
        Path | None,
        typer.Option(
            "--drives",
            metavar="FOLDER",
            help="Keeps the simulated drives there, for other estimators on the same cars.",
            show_default=False,
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, help="Processes.  [default: one per core]", show_default=False),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", "-f", help="Throw away what another study left in the folder.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate many cars, each a little different from what the estimator believes, and rank what hurts it.

    A study with several vehicles is a catalogue: it says of every drive how far the estimates can be trusted.

    Ctrl-C keeps every finished run, and the same command goes on from there. Exit code 3: a run failed.
    """
    with activity("loading", show=STDERR.is_terminal):
        from dctorque_can.resources import find_study
        from dctorque_can.study.catalogue import is_catalogue, load_catalogue
        from dctorque_can.study.plan import load_study
        from dctorque_can.study.results import Results
        from dctorque_can.study.summary import summarise

        changes = _changes(
            vehicle=vehicle, drive=drive, profile=profile, duration_s=duration, seed=seed, runs=runs
        )
        path = find_study(file)
        if smooth:
            changes["smooth"] = True
        if is_catalogue(path):
            if "vehicle" in changes:
                changes["vehicles"] = [changes.pop("vehicle")]
            catalogue = load_catalogue(path, configuration.overrides(settings), changes)
        else:
            catalogue = None
            loaded = load_study(path, configuration.overrides(settings), changes)
    if catalogue is not None:
        named = "_".join(["study", path.stem, *_named(changes)])
        _catalogue(catalogue, folder or Path("out") / named, jobs, drives, force, as_json)
        return
    for warning in loaded.config.warnings:
        warn(str(warning).replace("warning: ", "", 1))
    folder = folder or Path("out") / "_".join(["study", loaded.path.stem, *_named(changes)])
    with Results(folder / "results.jsonl", loaded.identity(), force, warn) as results:
        try:
            _run(loaded, results, jobs, drives)
        except KeyboardInterrupt as interrupt:
            done = results.finished(loaded.plan.runs)
            say(f"interrupted: {done} of {loaded.plan.runs} runs are kept; the same command goes on from there")
            raise typer.Exit(ExitCode.INTERRUPTED) from interrupt
        with activity("ranking the factors", show=STDERR.is_terminal):
            summary = summarise(loaded, results.records)
            files = _write(summary, folder)
    _show(summary, files, as_json)
    if summary.failed:
        raise typer.Exit(ExitCode.INCOMPLETE)


def _catalogue(
    catalogue: Catalogue, folder: Path, jobs: int | None, drives: Path | None, force: bool, as_json: bool
) -> None:
    """Make the runs of a catalogue that are not there yet, and show all of them."""
    from dctorque_can.report.catalogue_table import CATALOGUE_WIDTH, catalogue_tables
    from dctorque_can.study.catalogue_run import CatalogueSetup
    from dctorque_can.study.catalogue_summary import summarise_catalogue
    from dctorque_can.study.pool import keep_runs
    from dctorque_can.study.results import Results

    values = catalogue.values()
    with Results(folder / "results.jsonl", catalogue.identity(), force, warn) as results:
        missing = {number: v for number, v in values.items() if number not in results.records}
        say(f"{len(missing)} of {len(values)} drives are missing" if missing else "all drives are there already")
        try:
            if missing:
                with progress_bar(f"{len(missing)} drives") as progress:
                    setup = CatalogueSetup.of(catalogue, drives)
                    keep_runs(setup, results, missing, len(values), jobs, progress)
        except KeyboardInterrupt as interrupt:
            done = len(results.records)
            say(f"interrupted: {done} of {len(values)} runs are kept; the same command goes on from there")
            raise typer.Exit(ExitCode.INTERRUPTED) from interrupt
        summary = summarise_catalogue(catalogue, results.records)
    files = {"results": str(folder / "results.jsonl"), "summary": str(folder / "summary.json")}
    summary.write(folder / "summary.json")
    _tell_failed(summary, files)
    if as_json:
        print_json(summary.as_json() | {"files": files})
    else:
        print_page(catalogue_tables(summary), CATALOGUE_WIDTH)
        for name, path in files.items():
            STDOUT.print(f"{name:8}{path}", soft_wrap=True)
    if summary.failed:
        raise typer.Exit(ExitCode.INCOMPLETE)


def _changes(vehicle: str | None, drive: str | None, **others: Any) -> dict[str, Any]:
    """Return the keys of the study that the command line changes, by name."""
    changes = {name: value for name, value in others.items() if value is not None}
    if vehicle is not None:  # a path is relative to here, not to the study file
        changes["vehicle"] = str(Path(vehicle).absolute()) if Path(vehicle).exists() else vehicle
    if drive is not None:
        changes = {"duration_s": None} | changes | {"drive": drive}
    return changes


def _named(changes: dict[str, Any]) -> list[str]:
    """Return what tells the folder of a changed study from that of the study itself."""
    words = {
        name: name if value is True else str(value)
        for name, value in changes.items()
        if value is not None and name != "runs"
    }
    return [Path(word).stem if name == "vehicle" else word for name, word in sorted(words.items())]


def _run(loaded: Study, results: Results, jobs: int | None, drives: Path | None) -> None:
    """Make the runs that are not there yet."""
    from dctorque_can.study.pool import make_runs, missing_runs

    missing = missing_runs(loaded, results)
    total = loaded.plan.runs + 1
    if not missing:
        say(f"all {loaded.plan.runs} runs are there already")
        return
    if len(missing) < total:
        say(f"{total - len(missing)} runs are there already, {len(missing)} are missing")
    what = f"{len(missing)} drives"
    if not STDERR.is_terminal:
        say(what)
    with progress_bar(what) as progress:
        make_runs(loaded, results, missing, jobs, drives, progress)


def _write(summary: StudySummary, folder: Path) -> dict[str, str]:
    files = {"results": folder / "results.jsonl", "summary": folder / "summary.json"}
    plot = folder / "sensitivity.png"
    if summary.sensitivities:
        from dctorque_can.report.plot_file import save_figure
        from dctorque_can.report.sensitivity_plot import study_figure

        save_figure(study_figure(summary), plot)
        files["plot"] = plot
    else:
        plot.unlink(missing_ok=True)  # of fewer factors or more runs
    summary.write(files["summary"])
    return {name: str(path) for name, path in files.items()}


def _tell_failed(summary: StudySummary | CatalogueSummary, files: dict[str, str]) -> None:
    for run, reason in list(summary.failed.items())[:_MOST_REASONS]:
        warn(f"run {run} failed: {reason}")
    if len(summary.failed) > _MOST_REASONS:
        warn(f"{len(summary.failed) - _MOST_REASONS} more runs failed; {files['summary']} names them")


def _show(summary: StudySummary, files: dict[str, str], as_json: bool) -> None:
    _tell_failed(summary, files)
    if not summary.sensitivities:
        say(f"no ranking: {summary.runs_for_ranking} good runs would be needed, there are {summary.used}")
    if as_json:
        result: dict[str, Any] = summary.as_json() | {"files": files}
        print_json(result)
        return
    from dctorque_can.report.study_tables import estimator_tables, quantile_table, ranking_table
    from dctorque_can.report.torque_table import WIDTH

    STDOUT.print(quantile_table(summary))
    if summary.estimators:
        print_page(estimator_tables(summary), WIDTH)
    if summary.sensitivities:
        STDOUT.print(ranking_table(summary))
    for name, path in files.items():
        STDOUT.print(f"{name:8}{path}", soft_wrap=True)
