"""``dctorque clutch-map``: what recordings say of each clutch: its torque by its position, and its health."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.console import STDERR, STDOUT, activity, print_json, progress_bar, say, warn
from dctorque_can.cli.exit_codes import ExitCode
from dctorque_can.cli.options import ConfigOption, ForceOption, JsonOption, SetOption


def clutch_map(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG...", help=".asc .blf .log .trc .csv .mf4 .mcap; several are one sequence."),
    ],
    config: ConfigOption = None,
    settings: SetOption = None,
    state: Annotated[
        Path | None,
        typer.Option("--state", metavar="DIR", help="Go on from the maps kept there, and keep them there again."),
    ] = None,
    truth: Annotated[bool, typer.Option("--truth", help="Compare with the truth of simulated logs.")] = False,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="PLOT.png", help="Draw the maps; .png, .svg or .pdf.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> None:
    """Learn the map of each clutch from recordings: its torque by what closes it, touch point, friction, wear.

    The configuration comes from --config, or travels in an MCAP log; the maps are learned even where it does not
    ask for them. Exit code 3: a part of a log could not be read.
    """
    with ExitStack() as stack:
        with activity("loading", show=STDERR.is_terminal):
            from dctorque_can.logs.output_file import refuse_existing
            from dctorque_can.logs.reader import open_log
            from dctorque_can.offline.clutch_map import learn_maps
            from dctorque_can.offline.replay import config_of
            from dctorque_can.report.clutch_map_lines import clutch_table, error_lines, node_table
            from dctorque_can.report.plot_file import PLOT_FORMATS

        if plot is not None:
            if plot.suffix.lower() not in PLOT_FORMATS:
                raise typer.BadParameter(f"{plot}: end its name in {', '.join(PLOT_FORMATS)}", param_hint="--plot")
            refuse_existing(plot, logs, force)
        readers = [stack.enter_context(open_log(path)) for path in logs]
        wanted = ["clutch_map.enabled=true", *(settings or [])]
        if config is not None:
            loaded = configuration.load(config, wanted)
        else:
            loaded = config_of(readers, configuration.overrides(wanted, None, None))
        with progress_bar("learning") as progress:
            found = learn_maps(readers, loaded, progress, _tell, state, truth)
    for problem in found.problems:
        warn(problem)
    result = found.as_json()
    if as_json:
        print_json(result)
    else:
        for clutch in result["clutches"]:
            STDOUT.print(node_table(clutch))
        STDOUT.print(clutch_table(result["clutches"]))
        for line in error_lines(result["errors"]):
            say(line)
        if found.state is not None:
            say(f"kept in {found.state}")
    if plot is not None:
        from dctorque_can.report.clutch_map_plot import map_figure
        from dctorque_can.report.plot_file import save_figure

        save_figure(map_figure(loaded.name, found.last), plot)
        say(f"plot in {plot}")
    if found.problems:
        raise typer.Exit(ExitCode.INCOMPLETE)


def _tell(is_error: bool, text: str) -> None:
    (warn if is_error else say)(text)
