"""``dctorque replay``: recorded frames to estimates, in a new log or in real time on a bus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.console import STDERR, STDOUT, activity, fail, print_json, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import (
    ChannelOption,
    ConfigOption,
    ForceOption,
    InterfaceOption,
    JsonOption,
    SetOption,
    SpeedOption,
)

if TYPE_CHECKING:
    from dctorque_can.config.load import Config
    from dctorque_can.logs.reader import LogReader
    from dctorque_can.offline.replay import ReplayResult


def replay(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG...", help=".asc .blf .log .trc .csv .mf4 .mcap; several are one sequence."),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="OUT.mcap", help="The new log.", show_default=False)
    ] = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    frames: Annotated[bool, typer.Option("--frames", help="Also write the frames to OUT.")] = False,
    signals: Annotated[bool, typer.Option("--signals", help="Also write the decoded signals to OUT.")] = False,
    truth: Annotated[
        bool, typer.Option("--truth", help="Compare with the truth of a simulated log, and copy it to OUT.")
    ] = False,
    smooth: Annotated[
        bool, typer.Option("--smooth", help="Smooth the estimates of the Kalman filter over the whole recording.")
    ] = False,
    state: Annotated[
        Path | None,
        typer.Option("--state", metavar="DIR", help="Begin with the clutch maps that are kept there."),
    ] = None,
    interface: InterfaceOption = None,
    channel: ChannelOption = None,
    speed: SpeedOption = 1.0,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate over recorded frames: as fast as possible into OUT.mcap, or in real time onto a bus.

    The configuration comes from --config, or travels in an MCAP log. With --interface or --channel the frames of
    the log and the frames of the estimates go onto that bus at --speed. With --smooth each estimate stands on all
    frames, also on later ones. Damaged logs: everything readable is used, each damaged place is a warning, and the
    exit code is 3.
    """
    if output is None and interface is None and channel is None:
        raise typer.BadParameter("say where to: -o OUT.mcap, or --interface and --channel of a bus")
    if output is not None and output.suffix.lower() != ".mcap":
        raise typer.BadParameter(f"{output}: the result is an MCAP log; end its name in .mcap", param_hint="-o")
    with ExitStack() as stack:
        with activity("loading", show=STDERR.is_terminal):
            from dctorque_can.analysis.health import doubts
            from dctorque_can.logs.output_file import refuse_existing
            from dctorque_can.logs.reader import open_log
            from dctorque_can.offline.replay import ReplayContent, ReplayTargets, replay_logs
            from dctorque_can.report.clutch_map_lines import map_lines
            from dctorque_can.report.message_lines import message_lines
            from dctorque_can.report.status_lines import finding_lines, hint_lines, status_lines, transmission_line

        if output is not None:
            refuse_existing(output, logs, force)
        readers = [stack.enter_context(open_log(path)) for path in logs]
        loaded = _config(readers, config, settings, interface, channel)
        player = None
        if interface is not None or channel is not None:
            from dctorque_can.offline.playback import Player, playing

            tell = playing(loaded.can, lambda is_error, text: (fail if is_error else say)(text))
            player = Player(stack.enter_context(tell), speed)
        with progress_bar("replaying") as progress:
            content = ReplayContent(frames=frames, signals=signals, truth=truth, smooth=smooth, state=state)
            result = replay_logs(readers, loaded, ReplayTargets(output, player), content, progress)
    for problem in result.problems:
        warn(problem)
    begins = f"{logs[0]}: begins with a state of the estimator"
    if result.state:
        warn(f"{begins}, which is not used: {result.state}; the estimator begins anew")
    if as_json:
        print_json(result.as_json())
    else:
        say(
            f"{result.frames} frames ({result.bus_seconds:.0f} s of traffic) in {result.seconds:.1f} s, "
            f"{result.estimates} {'smoothed ' if smooth else ''}estimates, "
            f"{result.valid_estimates} with valid clutch torques" + (f", in {output}" if output else "")
        )
        for line in status_lines(result.status, result.status_time) if result.estimates else ():
            say(line)
        if result.state == "":
            say(f"{begins}, and goes on from it")
        if result.transmission is not None:
            say(transmission_line(result.transmission))
        for line in finding_lines(result.health["findings"]):
            say(line)
        if result.health["nis"]:
            sensors = (f"{name.replace('_', ' ')} {nis:.2f}" for name, nis in result.health["nis"].items())
            say(f"normalised innovations squared (1 is right): {', '.join(sensors)}")
            say(learned(result.health["engine_torque"]))
            say(learned_of_speeds(result.health["speeds"]))
        for line in hint_lines(result.health["hints"]):
            say(line)
        for line in (*map_lines(result.clutch_map), *message_lines(result.messages)):
            say(line)
        if player is not None:
            say(f"{player.sent} frames sent, {player.failed} not taken")
        if result.errors is not None:
            from dctorque_can.report.errors_table import errors_table

            STDOUT.print(errors_table(result.errors, "Errors against the truth"))
    missing = _tell_what_is_held(result)
    if result.traffic.mapped_frames:
        if not result.estimates:
            warn("no estimate: none of the frames gave what the estimator needs (see `dctorque check`)")
        for doubt in doubts(result.never_received, result.estimates, result.valid_estimates):
            warn(doubt)
    if result.problems or missing or (player is not None and player.failed):
        raise typer.Exit(ExitCode.INCOMPLETE)


def _tell_what_is_held(result: ReplayResult) -> bool:
    """Tell what the logs hold that was not read, and what is missing in them; return whether something is."""
    from dctorque_can.report.traffic_lines import (
        holds_no_frames,
        missing_lines,
        not_our_own,
        short_lines,
        sorted_frames,
        unread_topics,
    )

    lines = [holds_no_frames(held.log, held.unread) for held in result.logs if not held.frames]
    if result.traffic.frames:
        lines += [*missing_lines(result.traffic, result.health), *short_lines(result.traffic, lacking=True)]
    for line in lines:
        warn(line)
    for line in short_lines(result.traffic, lacking=False):
        say(line)
    for held in result.logs:
        if held.sorted_frames:
            say(sorted_frames(held.log, held.sorted_frames, held.frames, held.sorted_by_us))
    for held in result.logs:
        others = not_our_own(held.unread)
        if held.frames and others:
            say(unread_topics(held.log, others))
    return bool(lines)


def _config(
    readers: Sequence[LogReader],
    path: Path | None,
    settings: Sequence[str] | None,
    interface: str | None,
    channel: str | None,
) -> Config:
    if path is not None:
        return configuration.load(path, settings, interface, channel)
    from dctorque_can.offline.replay import config_of

    return config_of(readers, configuration.overrides(settings, interface, channel))


def learned(engine_torque: Mapping[str, float]) -> str:
    """Say what was learned of the nominal engine torque by the end."""
    return (
        "engine torque against the nominal one: "
        f"{100 * engine_torque['gain_error']:+.1f} ± {100 * engine_torque['gain_sigma']:.1f} %, "
        f"{1000 * engine_torque['lag_error_s']:+.0f} ± {1000 * engine_torque['lag_sigma_s']:.0f} ms late "
        "(beyond engine_torque_lag_ms)"
    )


def learned_of_speeds(speeds: Mapping[str, float]) -> str:
    """Say what was learned of the speeds by the end."""
    return (
        "wheels against the shafts: "
        f"{100 * speeds['wheel_scale_error']:+.2f} ± {100 * speeds['wheel_scale_sigma']:.2f} %, "
        f"{1000 * speeds['wheels_late_s']:+.1f} ± {1000 * speeds['wheels_late_sigma_s']:.1f} ms late "
        "(beyond delay_ms)"
    )
