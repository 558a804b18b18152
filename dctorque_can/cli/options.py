"""Options that several subcommands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

ConfigArgument = Annotated[
    Path | None, typer.Argument(metavar="[CONFIG]", help="Vehicle configuration (YAML).", show_default=False)
]
ConfigOption = Annotated[
    Path | None,
    typer.Option("--config", "-c", metavar="CONFIG", help="Vehicle configuration (YAML).", show_default=False),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override one key of the configuration, e.g. --set can.channel=can1; may be repeated.",
        show_default=False,
    ),
]
InterfaceOption = Annotated[
    str | None,
    typer.Option(
        "--interface", "-i", help="python-can interface, e.g. socketcan, pcan, virtual.", show_default=False
    ),
]
ChannelOption = Annotated[
    str | None, typer.Option("--channel", help="Channel of the interface, e.g. can0.", show_default=False)
]
ForceOption = Annotated[bool, typer.Option("--force", "-f", help="Overwrite the output if it exists.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the summary as one JSON object on stdout.")]
DriveChoice = Annotated[
    Literal[
        "paper",
        "mixed",
        "creep",
        "roll_back",
        "hill_hold",
        "braked_coast_down",
        "hard_braking",
        "kick_down",
        "reverse",
        "sailing",
        "stop_start",
        "wheel_spin",
        "split_mu",
        "aborted_shift",
        "tie_up",
        "hard_synchroniser",
        "judder",
        "friction_fading",
        "touch_point_drift",
        "friction_drift",
    ],
    typer.Option(
        "--drive",
        help="paper: section 4.1 of the paper, 16 s uphill. mixed: traffic, from 180 s. "
        "friction_drift: the same for 20 min, clutches lose 30 % of their friction. Others: a manoeuvre.",
    ),
]
UnsignedChoice = Annotated[
    Literal["none", "wheels", "shafts", "all"],
    typer.Option(
        "--unsigned", help="Speeds sent as their magnitude, without sign: of wheels, input shafts or all."
    ),
]
ProfileChoice = Annotated[
    Literal["laboratory", "production", "inertial", "one_gear", "more"],
    typer.Option(
        "--profile",
        help="laboratory: every signal at 1 kHz with noise. production: 10/20 ms, quantised, delayed, jittering. "
        "inertial: production with acceleration and grade. one_gear: production with "
        "one gear for the whole gearbox. more: production with the messages of demo_car_more.dbc.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Of the noise, and of a mixed drive.")]
DurationOption = Annotated[
    float | None,
    typer.Option(
        "--duration",
        metavar="SECONDS",
        min=1.0,
        help="Length of the drive.  [default: 16, of mixed 360, of a manoeuvre its own]",
        show_default=False,
    ),
]
SpeedOption = Annotated[
    float, typer.Option("--speed", metavar="FACTOR", min=0.001, help="Bus seconds per second, on a bus.")
]


def plot_format(output: Path | None) -> None:
    """Refuse a plot whose suffix says no format; that is wrong usage."""
    if output is None:
        return
    from dctorque_can.report.plot_file import PLOT_FORMATS

    if output.suffix.lower() not in PLOT_FORMATS:
        known = ", ".join(PLOT_FORMATS)
        raise typer.BadParameter(f"{output}: the suffix says no known format; known are {known}", param_hint="-o")
