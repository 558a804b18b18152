"""``dctorque demo``: the whole job on a simulated car, with figures and a plot."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.console import STDERR, STDOUT, activity, fail, print_json, progress_bar, say
from dctorque_can.cli.options import (
    DriveChoice,
    DurationOption,
    JsonOption,
    ProfileChoice,
    SeedOption,
    SetOption,
)


def demo(
    config: Annotated[
        Path, typer.Argument(metavar="[CONFIG]", help="Vehicle file; it must use the messages of demo_car.dbc.")
    ] = Path("paper_car"),
    settings: SetOption = None,
    folder: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Takes demo.mcap and demo.png.")
    ] = Path("out"),
    drive: DriveChoice = "paper",
    profile: ProfileChoice = "laboratory",
    seed: SeedOption = 1,
    duration: DurationOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show the whole job: a simulated car on a virtual CAN bus, the service of `dctorque run`, its log and errors.

    The frames go as fast as the service takes them. Estimates are compared with the truth over the whole drive.
    """
    with activity("loading", show=STDERR.is_terminal):
        from dctorque_can.offline.demo import Demo
        from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car

        settings = ["output.enabled=true", "can.listen_only=false", *(settings or [])]
        loaded = configuration.load(config, settings, "virtual", f"dctorque demo {time.monotonic_ns()}")
        show = Demo(loaded, folder, _tell)
    what = "simulating the drive"
    if not STDERR.is_terminal:
        say(what)
    with progress_bar(what) as progress:
        simulated = simulate_car(loaded, DriveName(drive), ProfileName(profile), seed, duration, progress)
    with activity("preparing the estimator"):
        show.prepare()
    say(f"{len(simulated.frames)} frames of the {simulated.name} go over a virtual bus to the service")
    with progress_bar("estimating") as progress:
        result = show.run(simulated, progress)
    plot = folder / "demo.png"
    with activity("drawing", show=STDERR.is_terminal):
        from dctorque_can.report.drive_plot import drive_figure
        from dctorque_can.report.plot_file import save_figure

        save_figure(drive_figure(result.estimates, simulated.truth, simulated.name), plot)
    if as_json:
        print_json(result.as_json() | {"plot": str(plot)})
        return
    from dctorque_can.report.errors_table import errors_table

    STDOUT.print(errors_table(result.errors, f"{loaded.name}: {simulated.name}"))
    summary = result.summary
    STDOUT.print(
        f"{summary.frames} frames in, {len(result.estimates)} estimates, {result.heard} frames out, "
        f"{summary.seconds:.1f} s for {simulated.seconds:.1f} s of driving"
    )
    STDOUT.print(f"log  {result.log}   (open it in Foxglove or PlotJuggler)", soft_wrap=True)
    STDOUT.print(f"plot {plot}", soft_wrap=True)


def _tell(is_error: bool, text: str) -> None:
    if is_error:
        fail(text)
