"""Configuration files as the command line names them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from dctorque_can.cli.console import warn

if TYPE_CHECKING:
    from dctorque_can.config.load import Config


def load(
    path: Path, settings: Sequence[str] | None, interface: str | None = None, channel: str | None = None
) -> Config:
    """Load a vehicle file with overrides, and show its warnings.

    Args:
        path: a file, or the bare name of a shipped one such as ``paper_car``.
        settings: ``KEY=VALUE`` of ``--set``.
        interface: overrides ``can.interface``.
        channel: overrides ``can.channel``.
    """
    from dctorque_can.config.load import load_config
    from dctorque_can.resources import find_config

    config = load_config(find_config(path), overrides(settings, interface, channel))
    for warning in config.warnings:
        warn(str(warning).replace("warning: ", "", 1))
    return config


def overrides(
    settings: Sequence[str] | None, interface: str | None = None, channel: str | None = None
) -> dict[str, str]:
    """Return dotted keys and values of the command line."""
    from dctorque_can.config.overrides import parse_overrides

    try:
        pairs = parse_overrides(list(settings or ()))
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--set") from error
    if interface is not None:
        pairs["can.interface"] = interface
    if channel is not None:
        pairs["can.channel"] = channel
    return pairs


def one_of(argument: Path | None, option: Path | None) -> Path | None:
    """Return the configuration given as argument or as option; giving both is wrong usage."""
    if argument is not None and option is not None:
        raise typer.BadParameter("give the configuration once: as CONFIG or with --config")
    return argument or option
