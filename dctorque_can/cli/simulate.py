"""``dctorque simulate``: a car for tests, as a log or live on a bus."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.console import STDERR, activity, fail, print_json, progress_bar, say
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import (
    ChannelOption,
    DriveChoice,
    DurationOption,
    ForceOption,
    InterfaceOption,
    JsonOption,
    ProfileChoice,
    SeedOption,
    SetOption,
    SpeedOption,
    UnsignedChoice,
)

if TYPE_CHECKING:
    from dctorque_can.config.load import Config
    from dctorque_can.offline.simulated_car import SimulatedDrive


def simulate(
    config: Annotated[
        Path,
        typer.Argument(
            metavar="[CONFIG]", help="Vehicle file; a car with a DBC of its own sends what the file reads."
        ),
    ] = Path("paper_car"),
    settings: SetOption = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="LOG", help="Log in the format of its suffix: .mcap, .asc, .blf, …"
        ),
    ] = None,
    interface: InterfaceOption = None,
    channel: ChannelOption = None,
    speed: SpeedOption = 1.0,
    drive: DriveChoice = "paper",
    profile: ProfileChoice = "production",
    unsigned: UnsignedChoice = "none",
    seed: SeedOption = 1,
    duration: DurationOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate a car and write its frames to a log (-o), or send them on a bus (--interface, --channel), or both.

    The truth goes into the log (topic /dctorque/truth), or beside it as .truth.mcap when the format has no place
    for it. Exit code 3: the bus did not take every frame.
    """
    if output is None and interface is None and channel is None:
        raise typer.BadParameter("say where to: -o LOG, or --interface and --channel of a bus")
    if output is not None:
        from dctorque_can.logs.formats import FORMATS

        if output.suffix.lower() not in FORMATS:
            known = ", ".join(FORMATS)
            raise typer.BadParameter(
                f"{output}: the suffix says no known log format; known are {known}", param_hint="-o"
            )
    with activity("loading", show=STDERR.is_terminal):
        from dctorque_can.logs.output_file import refuse_existing
        from dctorque_can.offline.simulated_car import (
            DriveName,
            ProfileName,
            Unsigned,
            simulate_car,
            write_log,
        )
        from dctorque_can.offline.truth_log import truth_path

        loaded = configuration.load(config, settings, interface, channel)
    for path in {output, truth_path(output)} if output is not None else ():
        refuse_existing(path, [], force)
    what = "simulating"
    if not STDERR.is_terminal:
        say(what)
    with progress_bar(what) as progress:
        simulated = simulate_car(
            loaded, DriveName(drive), ProfileName(profile), seed, duration, progress, Unsigned(unsigned)
        )
    result: dict[str, Any] = {"frames": len(simulated.frames), "seconds": simulated.seconds}
    if output is not None:
        with activity(f"writing {output}", show=STDERR.is_terminal):
            truth = write_log(loaded, simulated, output)
        result |= {"log": str(output), "truth": str(truth)}
        say(f"{len(simulated.frames)} frames of the {simulated.name} in {output}, the truth in {truth}")
    if interface is not None or channel is not None:
        result |= _send(loaded, simulated, speed)
    if as_json:
        print_json(result)
    if result.get("failed"):
        raise typer.Exit(ExitCode.INCOMPLETE)


def _send(config: Config, simulated: SimulatedDrive, speed: float) -> dict[str, Any]:
    from dctorque_can.offline.playback import Player, playing

    name = f"{config.can.interface}:{config.can.channel}"
    with playing(config.can, lambda is_error, text: (fail if is_error else say)(text)) as link:
        player = Player(link, speed)
        say(f"sending {len(simulated.frames)} frames of the {simulated.name} on {name}")
        with progress_bar(f"sending on {name}") as progress:
            player.play(simulated.frames, progress)
    say(f"{player.sent} frames sent, {player.failed} not taken, at most {1000 * player.latest_s:.1f} ms late")
    return {"sent": player.sent, "failed": player.failed, "latest_ms": 1000 * player.latest_s}
