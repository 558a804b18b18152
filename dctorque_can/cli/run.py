"""``dctorque run``: estimate live on a CAN bus."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.compile_notice import compiling_is_over
from dctorque_can.cli.console import STDERR, activity, fail, print_json, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import (
    ChannelOption,
    ConfigArgument,
    ConfigOption,
    ForceOption,
    InterfaceOption,
    JsonOption,
    SetOption,
)

if TYPE_CHECKING:
    from dctorque_can.config.load import Config
    from dctorque_can.daemon.service import Service, Summary


def run(
    config: ConfigArgument = None,
    config_option: ConfigOption = None,
    settings: SetOption = None,
    interface: InterfaceOption = None,
    channel: ChannelOption = None,
    log: Annotated[
        Path | None,
        typer.Option("--log", metavar="FILE", help="First log, instead of a name in logging.directory."),
    ] = None,
    no_log: Annotated[bool, typer.Option("--no-log", help="Write no log.")] = False,
    force: ForceOption = False,
    duration: Annotated[
        float | None, typer.Option("--duration", metavar="SECONDS", min=0.0, help="Stop after this time.")
    ] = None,
    wait: Annotated[
        bool, typer.Option("--wait", help="Wait for a bus that is not there yet, instead of giving up.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Estimate live: receive, estimate, send (when the configuration enables the output) and log.

    Ends with exit code 0 and a closed log on Ctrl-C or SIGTERM, or after --duration. SIGHUP begins a new log.
    A bus that goes away while running is waited for. Exit code 3: frames are missing in the log.
    """
    path = configuration.one_of(config, config_option)
    if path is None:
        raise typer.BadParameter("name a vehicle file, e.g. config/paper_car.yaml", param_hint="CONFIG")
    if log is not None and no_log:
        raise typer.BadParameter("--log and --no-log contradict each other")
    if log is not None and log.suffix.lower() != ".mcap":
        raise typer.BadParameter(f"{log}: the log is an MCAP; end its name in .mcap", param_hint="--log")
    try:
        loaded = configuration.load(path, settings, interface, channel)
        prepared = _prepare(loaded, log, no_log, force)
    except KeyboardInterrupt:  # from here on signals stop the service
        say("stopped before it began")
        return
    try:
        summary = _serve(loaded, prepared, duration, wait)
    except KeyboardInterrupt:  # while it compiled
        say("stopped before it began")
        return
    if as_json:
        print_json(summary.as_json())
    else:
        _show(summary)
    if summary.frames:
        from dctorque_can.analysis.health import doubts

        for doubt in doubts(summary.never_received, summary.estimates, summary.valid_estimates):
            warn(doubt)
    if not summary.complete:
        raise typer.Exit(ExitCode.INCOMPLETE)


def _prepare(config: Config, log: Path | None, no_log: bool, force: bool) -> Service:
    from functools import partial

    from dctorque_can.daemon.link import open_bus
    from dctorque_can.daemon.log_plan import plan_for
    from dctorque_can.daemon.service import Service
    from dctorque_can.daemon.signals import obeying_signals  # noqa: F401  loaded while a signal still ends all
    from dctorque_can.logs.output_file import refuse_existing

    if log is not None:
        refuse_existing(log, [], force)
    wanted = not no_log and (log is not None or config.logging.enabled)
    plan = plan_for(config, log) if wanted else None
    return Service(config, [partial(open_bus, bus.arguments()) for bus in config.buses], plan, _tell)


def _serve(config: Config, service: Service, duration: float | None, wait: bool) -> Summary:
    from dctorque_can.daemon.signals import obeying_signals

    with obeying_signals(service):
        with activity("preparing", STDERR.is_terminal):
            service.prepare(wait_for_bus=wait)
        compiling_is_over()
        if not service.stopped:
            say(f"{config.name}: estimating on {' and '.join(map(str, config.buses))}; Ctrl-C stops")
        return service.run(duration)


def _tell(is_error: bool, text: str) -> None:
    if is_error:
        fail(text)
    else:
        say(text)


def _show(summary: Summary) -> None:
    from dctorque_can.report.clutch_map_lines import map_lines
    from dctorque_can.report.status_lines import finding_lines, hint_lines, status_lines, transmission_line

    log = summary.log
    say(
        f"{summary.seconds:.1f} s: {summary.frames} frames in, {summary.estimates} estimates, "
        f"{summary.published} frames out"
        + ("" if summary.cpu_share is None else f", {100 * summary.cpu_share:.0f} % of one processor")
    )
    for line in status_lines(summary.status, summary.status_time) if summary.estimates else ():
        say(line)
    if summary.transmission is not None:
        say(transmission_line(summary.transmission))
    for line in finding_lines(summary.health["findings"]):
        say(line)
    for line in hint_lines(summary.health["hints"]):
        say(line)
    for line in map_lines(summary.clutch_map):
        say(line)
    several = len(summary.buses) > 1
    for bus in summary.buses:
        if several or any(bus[name] for name in ("lost", "send_failures", "error_frames", "damaged", "dropped")):
            state = "" if bus["open"] else "not there at the end, "
            frames = f"{bus['received']} frames, " if several else ""
            say(
                f"{bus['name'] if several else 'bus'}: {frames}{state}lost {bus['lost']} times, "
                f"back {bus['reconnects']} times, {bus['error_frames']} error frames, {bus['bus_offs']} bus-offs, "
                f"{bus['dropped']} frames not fetched in time, {bus['damaged']} damaged lines, "
                f"{bus['send_failures']} frames not sent"
            )
    if summary.clock_steps:
        say(f"clock: the time of the frames was set {summary.clock_steps} times")
    faults = {name: count for name, count in summary.health.items() if count and name not in ("findings", "hints")}
    if faults:
        say("health: " + ", ".join(f"{name} {_shown(count)}" for name, count in faults.items()))
    if log is not None:
        paths = ", ".join(str(path) for path in log.paths)
        say(f"log: {log.written} frames in {paths}" + (f"; {log.dropped} frames missing" if log.dropped else ""))
        if log.late_flushes:
            say(
                f"log: {log.late_flushes} times later with the operating system than logging.flush_ms, "
                f"{log.slowest_flush_ms:.0f} ms after receiving at most"
            )


def _shown(count: object) -> str:
    if isinstance(count, dict):
        return "(" + ", ".join(f"{name} {number}" for name, number in count.items()) + ")"
    return str(count)
