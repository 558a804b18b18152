"""``dctorque design CONFIG``: gains of the 2014 observer, what it can see, how stable and how noisy it is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.console import STDERR, STDOUT, activity, print_json, print_page
from dctorque_can.cli.options import JsonOption, SetOption, plot_format
from dctorque_can.errors import DctorqueError

if TYPE_CHECKING:
    from dctorque_can.driveline.parameters import Vehicle

Noise = Annotated[float, typer.Option(metavar="RAD/S", min=0.0, help="Standard deviation of one sample.")]


def design(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="Vehicle configuration (YAML).")],
    settings: SetOption = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="PLOT", help="Plot of noise and lag: .png, .svg or .pdf."),
    ] = None,
    all_pairs: Annotated[
        bool, typer.Option("--all-pairs", help="Every gear of shaft 1 with every gear of shaft 2.")
    ] = False,
    pair: Annotated[
        str | None,
        typer.Option("--pair", metavar="A-B", help="Gears whose bandwidths are varied.  [default: the first]"),
    ] = None,
    vary: Annotated[
        Literal["all", "unknown-input", "crossover", "wheel"],
        typer.Option("--vary", help="Bandwidths that are scaled by 0.25 to 4."),
    ] = "all",
    noise_engine: Noise = 0.3,
    noise_shaft: Noise = 0.3,
    noise_wheel: Noise = 0.02,
    period: Annotated[
        str,
        typer.Option("--period-ms", metavar="MS[,MS,MS]", help="Of all speeds, or of engine, shafts, wheels."),
    ] = "1",
    ramp: Annotated[
        float, typer.Option("--ramp", metavar="N·M/S", min=1.0, help="Hand-over from clutch to clutch.")
    ] = 1000.0,
    as_json: JsonOption = False,
) -> None:
    """Judge the gains of the 2014 observer: poles, what cannot be observed, stability, noise against lag.

    Everything is computed from the vehicle file, whichever method it names; nothing is simulated. Exit codes:
    0 done, also when a condition is violated, 1 error, 2 wrong usage.
    """
    plot_format(output)
    with activity("loading", show=STDERR.is_terminal):
        from dctorque_can.estimators.oh2014.driving_conditions import all_pairs as every_pair
        from dctorque_can.estimators.oh2014.driving_conditions import neighbouring_pairs
        from dctorque_can.estimators.oh2014.noise_and_lag import SpeedSensors

        periods = _periods_us(period)
        sensors = SpeedSensors(noise_engine, noise_shaft, noise_wheel, *periods)
        loaded = configuration.load(config, settings)
        vehicle = loaded.settings.vehicle
        pairs = every_pair(vehicle) if all_pairs else neighbouring_pairs(vehicle)
        if not pairs:
            raise DctorqueError(
                f"{loaded.path}: no two forward gears next to each other are on different shafts"
                + ("" if all_pairs else "; --all-pairs takes all others")
            )
        chosen = pairs[0] if pair is None else _chosen(pair, vehicle)
    with activity("computing", show=STDERR.is_terminal):
        from dctorque_can.design.judgement import Design

        listed = pairs if chosen in pairs else (*pairs, chosen)
        found = Design(loaded.settings, listed, sensors, ramp).report(chosen, vary)
    report = {"file": str(loaded.path), "name": loaded.name, **found}
    if output is not None:
        from dctorque_can.report.noise_lag_plot import design_figure
        from dctorque_can.report.plot_file import save_figure

        save_figure(design_figure(report), output)
        report["plot"] = str(output)
    if as_json:
        print_json(report)
        return
    from dctorque_can.report.design_tables import design_tables
    from dctorque_can.report.torque_table import WIDTH

    print_page(design_tables(report), WIDTH)
    if output is not None:
        STDOUT.print(f"plot {output}", soft_wrap=True, markup=False)


def _periods_us(text: str) -> tuple[int, int, int]:
    """Return the periods of engine, shaft and wheel speeds."""
    try:
        given = [round(float(part) * 1000) for part in text.split(",")]
    except (ValueError, OverflowError):
        given = []
    if len(given) not in (1, 3) or not all(100 <= value <= 10_000_000 for value in given):
        raise typer.BadParameter(
            f"{text}: one period or three (engine,shafts,wheels) from 0.1 to 10000", param_hint="--period-ms"
        )
    engine, shafts, wheels = given if len(given) == 3 else given * 3
    return engine, shafts, wheels


def _chosen(text: str, vehicle: Vehicle) -> tuple[int, int]:
    """Return the pair that ``A-B`` names, in any order."""
    from dctorque_can.estimators.oh2014.driving_conditions import all_pairs

    known = {frozenset("R" if g < 0 else str(g) for g in pair): pair for pair in all_pairs(vehicle)}
    wanted = frozenset(text.upper().split("-"))
    if wanted not in known:
        example = "-".join(sorted(next(iter(known)))) if known else "none"
        raise typer.BadParameter(
            f"{text}: not a gear of shaft 1 and one of shaft 2, such as {example}", param_hint="--pair"
        )
    return known[wanted]
