"""``dctorque status``: what a running service is doing."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from dctorque_can.cli.console import STDOUT, print_json
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import JsonOption

STALE_S = 5.0


def status(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Instance of dctorque@NAME.service.", show_default=False),
    ] = None,
    socket: Annotated[
        Path | None,
        typer.Option(
            "--socket", "-s", metavar="PATH", help="Socket of `dctorque run --status PATH`.", show_default=False
        ),
    ] = None,
    watch: Annotated[
        float | None,
        typer.Option("--watch", "-w", metavar="SECONDS", min=0.2, help="Show it again and again, until Ctrl-C."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show what a running service is doing: rates, ages, latency, faults, logs.

    Exit code 0: told. 1: nobody answers. 3: the latest status is older than 5 s, so
    the service hangs. With --json and --watch each status is one line.
    """
    from dctorque_can.daemon.status.client import read_status, socket_of

    if name is not None and socket is not None:
        raise typer.BadParameter("NAME and --socket contradict each other")
    path = socket if socket is not None else socket_of(name)
    now = read_status(path)
    if watch is None:
        _show(now, as_json)
        if float(now["snapshot_age_s"]) > STALE_S:
            raise typer.Exit(ExitCode.INCOMPLETE)
        return
    try:
        while True:
            _show_next(now, as_json)
            time.sleep(watch)
            now = read_status(path)
    except KeyboardInterrupt:
        return


def _show(now: dict[str, Any], as_json: bool) -> None:
    if as_json:
        print_json(now)
        return
    from dctorque_can.report.status_page import status_page

    for line in status_page(now):
        STDOUT.print(line, markup=False, soft_wrap=True)


def _show_next(now: dict[str, Any], as_json: bool) -> None:
    if as_json:
        import json

        STDOUT.file.write(json.dumps(now, allow_nan=False) + "\n")
        STDOUT.file.flush()
        return
    if STDOUT.is_terminal:
        STDOUT.clear()
    _show(now, as_json)
