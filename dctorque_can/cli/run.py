"""``dctorque run``: estimate live on a CAN bus."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
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
    listen_only: Annotated[
        bool, typer.Option("--listen-only", help="Send nothing on any bus, whatever the vehicle file says.")
    ] = False,
    status: Annotated[
        Path | None,
        typer.Option(
            "--status",
            metavar="PATH",
            help="Unix socket for `dctorque status`.  [default: status.socket of the file, or "
            "$RUNTIME_DIRECTORY/status.sock]",
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Estimate live: receive, estimate, send (when the configuration enables the output) and log.

    Ends with exit code 0 and a closed log on Ctrl-C or SIGTERM, or after --duration. SIGUSR1 begins a new
    log, SIGHUP reads the vehicle file anew.
    A bus that goes away while running is waited for. Exit code 3: frames are missing in the log, or none came that
    is mapped within --duration. Exit code 78: the vehicle file is wrong.
    """
    path = configuration.one_of(config, config_option)
    if path is None:
        raise typer.BadParameter("name a vehicle file, e.g. config/paper_car.yaml", param_hint="CONFIG")
    if log is not None and no_log:
        raise typer.BadParameter("--log and --no-log contradict each other")
    if log is not None and log.suffix.lower() != ".mcap":
        raise typer.BadParameter(f"{log}: the log is an MCAP; end its name in .mcap", param_hint="--log")
    try:
        loaded = _load(path, settings, interface, channel, listen_only)
        anew = partial(_read_anew, path, configuration.overrides(settings, interface, channel), listen_only)
        prepared = _prepare(loaded, log, no_log, force, status, anew)
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
        from dctorque_can.report.run_lines import run_lines

        for line in run_lines(summary.as_json()):
            say(line)
    for line in summary.missing:
        warn(line)
    if summary.frames:
        from dctorque_can.analysis.health import doubts

        for doubt in doubts(summary.never_received, summary.estimates, summary.valid_estimates):
            warn(doubt)
    in_vain = duration is not None and not prepared.stopped and summary.missing and not summary.estimates
    if not summary.complete or in_vain:
        raise typer.Exit(ExitCode.INCOMPLETE)


def _load(
    path: Path, settings: list[str] | None, interface: str | None, channel: str | None, listen_only: bool
) -> Config:
    """Load the vehicle file; what is wrong with it has an exit code of its own, for those who start it again."""
    from dctorque_can.config.problems import ConfigError

    try:
        config = configuration.load(path, settings, interface, channel)
    except ConfigError as error:
        error.exit_code = ExitCode.CONFIG
        raise
    return config.listening_only() if listen_only else config


def _read_anew(path: Path, overrides: Mapping[str, str], listen_only: bool) -> Config:
    """Read the vehicle file while the service runs."""
    from dctorque_can.config.load import load_config
    from dctorque_can.resources import find_config

    config = load_config(find_config(path), overrides)
    return config.listening_only() if listen_only else config


def _prepare(
    config: Config,
    log: Path | None,
    no_log: bool,
    force: bool,
    status: Path | None,
    anew: Callable[[], Config],
) -> Service:
    from dctorque_can.daemon.log.plan import plan_for
    from dctorque_can.daemon.service import Service
    from dctorque_can.daemon.signals import obeying_signals  # noqa: F401  loaded while a signal still ends all
    from dctorque_can.daemon.status.process import places_for
    from dctorque_can.daemon.wire.link import open_bus
    from dctorque_can.logs.output_file import refuse_existing

    if log is not None:
        refuse_existing(log, [], force)
    wanted = not no_log and (log is not None or config.logging.enabled)
    plan = plan_for(config, log) if wanted else None
    return Service(
        config,
        [partial(open_bus, bus.arguments(), bus.listen_only) for bus in config.buses],
        plan,
        _tell,
        places=places_for(config.status, status),
        reread=anew,
    )


def _serve(config: Config, service: Service, duration: float | None, wait: bool) -> Summary:
    from dctorque_can.daemon.signals import obeying_signals

    with obeying_signals(service):
        with activity("preparing", STDERR.is_terminal):
            service.prepare(wait_for_bus=wait)
        compiling_is_over()
        if not service.stopped:
            say(f"{config.name}: estimating on {' and '.join(map(str, config.buses))}; Ctrl-C stops")
            if silent := [str(bus) for bus in config.buses if bus.listen_only]:
                say(f"only listening to {' and '.join(silent)}")
        return service.run(duration)


def _tell(is_error: bool, text: str) -> None:
    if is_error:
        fail(text)
    else:
        say(text)
