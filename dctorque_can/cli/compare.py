"""``dctorque compare``: estimators side by side on the same frames, against the truth."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.console import STDERR, STDOUT, activity, print_json, print_page, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import (
    ConfigOption,
    DriveChoice,
    DurationOption,
    JsonOption,
    ProfileChoice,
    SeedOption,
    SetOption,
    plot_format,
)

if TYPE_CHECKING:
    from dctorque_can.config.load import Config
    from dctorque_can.logs.reader import LogReader
    from dctorque_can.offline.simulated_car import SimulatedDrive

ONLY_SIMULATED = ("drive", "profile", "seed", "seeds", "duration")
_NAME = re.compile(r"[\w.+-]{1,16}")
_NEXT_KEY = re.compile(r",(?=\s*[\w.]+=)")


def compare(
    context: typer.Context,
    logs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[LOG]...", help="Logs of `dctorque simulate`; without, drives are simulated."),
    ] = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variant",
            metavar="NAME=KEY=VALUE,…",
            help="One more estimator: the configuration with these keys overridden; may be repeated.",
            show_default=False,
        ),
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Also the Kalman filter smoothed: what its whole recording can tell.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="PLOT", help="Plot of the figures: .png, .svg or .pdf."),
    ] = None,
    drive: DriveChoice = "paper",
    profile: ProfileChoice = "production",
    seed: SeedOption = 1,
    seeds: Annotated[
        int, typer.Option("--seeds", metavar="N", min=1, help="How many drives, with --seed and those after it.")
    ] = 1,
    duration: DurationOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare estimators on the same frames: errors, lag, and what their standard deviations are worth.

    The 2014 observer, the Kalman filter, every --variant, and as a bound the Kalman filter that is told the true
    car, gears and clutch phases. Each LOG is a drive of its own and must carry its truth. Exit code 3: a log is
    damaged.
    """
    plot_format(output)
    given = [name for name in ONLY_SIMULATED if _is_given(context, name)]
    if logs and given:
        raise typer.BadParameter(f"--{given[0]} is for simulated drives; leave it out, or the logs")
    more = _variants(variants or [])
    with activity("loading", show=STDERR.is_terminal), ExitStack() as stack:
        from dctorque_can.logs.reader import open_log
        from dctorque_can.offline.comparison import (
            compare_bound,
            compare_variants,
            count_shifts,
            recorded_drive,
            variants_of,
        )
        from dctorque_can.offline.findings import as_report

        readers = [stack.enter_context(open_log(path)) for path in logs or []]
        loaded = _config(readers, config, settings, {})
        chosen = variants_of(lambda overrides: _config(readers, config, settings, overrides), more, smooth)
        for warning in dict.fromkeys(str(w) for v in chosen for w in v.config.warnings):
            warn(warning.replace("warning: ", "", 1))
        drives = [recorded_drive(reader) for reader in readers]
        problems = [problem for reader in readers for problem in reader.problems]
    if not drives:
        drives = _simulated(loaded, drive, profile, range(seed, seed + seeds), duration)
    what = "estimating"
    if not STDERR.is_terminal:
        say(what)
    with progress_bar(what) as progress:
        share = len(chosen) / (len(chosen) + 1)
        results = compare_variants(chosen, drives, lambda done: progress(share * done))
        bound = compare_bound(loaded, drives, lambda done: progress(share + (1 - share) * done))
    report = as_report(loaded.name, [d.name for d in drives], count_shifts(drives), results, bound)
    if output is not None:
        from dctorque_can.report.comparison_plot import comparison_figure
        from dctorque_can.report.plot_file import save_figure

        title = f"{loaded.name}: {Path(drives[0].name).name}" + (
            f" and {len(drives) - 1} more" if len(drives) > 1 else ""
        )
        save_figure(comparison_figure({r.variant.name: r.comparison for r in (*results, bound)}, title), output)
        report["plot"] = str(output)
    for text in (*problems, *(doubt for result in (*results, bound) for doubt in result.doubts)):
        warn(text)
    if as_json:
        print_json(report)
    else:
        from dctorque_can.report.comparison_tables import comparison_tables
        from dctorque_can.report.torque_table import WIDTH

        print_page(comparison_tables(report), WIDTH)
        if output is not None:
            STDOUT.print(f"plot {output}", soft_wrap=True, markup=False)
    if problems:
        raise typer.Exit(ExitCode.INCOMPLETE)


def _is_given(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name != "DEFAULT"


def _variants(texts: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return the overrides of each ``NAME=KEY=VALUE,KEY=VALUE`` by name."""
    from dctorque_can.config.overrides import parse_overrides

    found: dict[str, dict[str, str]] = {}
    for text in texts:
        name, _, rest = text.partition("=")
        try:
            if not _NAME.fullmatch(name):
                raise ValueError("the name must be 1 to 16 letters, digits or any of . _ + -")
            if name in found:
                raise ValueError(f"there are two variants {name}")
            found[name] = parse_overrides(_NEXT_KEY.split(rest))
        except ValueError as error:
            example = "such as quick=estimator.method=kalman,estimator.kalman.torque_rate_time_s=0.02"
            raise typer.BadParameter(f"{text}: {error}; {example}", param_hint="--variant") from error
    return found


def _config(
    readers: Sequence[LogReader], path: Path | None, settings: Sequence[str] | None, more: Mapping[str, str]
) -> Config:
    """Load the named vehicle file, or that of the first log, or the paper's; ``more`` comes after ``settings``."""
    from dctorque_can.config.load import load_config
    from dctorque_can.offline.replay import config_of
    from dctorque_can.resources import find_config

    overrides = configuration.overrides(settings) | dict(more)
    if path is None and readers:
        return config_of(readers, overrides)
    return load_config(find_config(path or Path("paper_car")), overrides)


def _simulated(
    config: Config, drive: str, profile: str, seeds: range, duration_s: float | None
) -> list[SimulatedDrive]:
    from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_cars

    what = "simulating"
    if not STDERR.is_terminal:
        say(what)
    with progress_bar(what) as progress:
        return simulate_cars(config, DriveName(drive), ProfileName(profile), seeds, duration_s, progress)
