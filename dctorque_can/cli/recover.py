"""``dctorque recover``: a clean log out of a damaged one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dctorque_can.cli.console import print_json, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import ForceOption, JsonOption


def recover(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="MCAP log, cut off or damaged.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="OUT", help="The new log.  [default: LOG.recovered.mcap]"),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Write everything whole of a damaged MCAP log to a new, indexed one.

    Exit code 0 also when something was lost: that is what the command is for; every lost place is named.
    """
    from dataclasses import asdict

    from dctorque_can.logs.mcap import recover as recovery
    from dctorque_can.logs.output_file import refuse_existing

    out = output or log.with_suffix(".recovered.mcap")
    refuse_existing(out, [log], force)
    if force and out.is_file():
        out.unlink()
    with progress_bar("recovering") as progress:
        result = recovery.recover(log, out, progress)
    for place in result.lost:
        warn(f"{log}: {place}")
    if result.unknown_messages:
        warn(f"{log}: {result.unknown_messages} messages left out: the definition of their channel is lost")
    if as_json:
        print_json(asdict(result) | {"output": str(out)})
    else:
        say(f"{result.messages} messages and {result.attachments} attachments saved in {out}")
    if not result.messages:
        raise typer.Exit(ExitCode.INCOMPLETE)
