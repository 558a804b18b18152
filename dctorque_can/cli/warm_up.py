"""``dctorque warm-up``: compile beforehand what the commands need."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from dctorque_can.cli import configuration
from dctorque_can.cli.compile_notice import compiling_is_over
from dctorque_can.cli.console import STDERR, activity, print_json, progress_bar, say
from dctorque_can.cli.options import ConfigArgument, JsonOption
from dctorque_can.compiling import watch

if TYPE_CHECKING:
    from dctorque_can.offline.warm_up import Step


def warm_up(
    config: ConfigArgument = None,
    method: Annotated[
        Literal["kalman", "oh2014"], typer.Option("--method", help="Which estimator the commands will use.")
    ] = "kalman",
    everything: Annotated[bool, typer.Option("--all", help="Compile both estimators.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Compile what all commands need, once for this machine; the second time there is nothing to do.

    With CONFIG: what `run` of this vehicle file needs, and no more. docs/cli.md says where compiled code is kept.
    """
    began_s = time.monotonic()
    with activity("loading", show=STDERR.is_terminal):
        from dctorque_can.compiling.places import own_folder, shipped
        from dctorque_can.offline.warm_up import warm_up as do_all

        if config is not None:
            if everything:
                raise typer.BadParameter("a vehicle file has one method; leave out --all or CONFIG")
            steps = _steps_of(config)
        else:
            steps = _all_steps(["kalman", "oh2014"] if everything else [method])
    with progress_bar("warming up") as progress:
        do_all(steps, lambda fraction, what: progress(fraction))
    result: dict[str, Any] = {
        "compiled": watch.so_far.functions,
        "cpu_seconds": round(watch.so_far.cpu_s, 3),
        "seconds": round(time.monotonic() - began_s, 3),
        "folder": str(own_folder()),
        "kept": bool(watch.so_far.folders) or not watch.so_far.functions,
        "shipped": shipped().is_dir(),
    }
    compiling_is_over()
    if as_json:
        print_json(result)
    elif not result["compiled"]:
        say(f"nothing to do: everything is compiled, in {_where(result)}")


def _where(result: dict[str, Any]) -> str:
    from dctorque_can.compiling.places import shipped

    return str(shipped() if result["shipped"] else result["folder"])


def _steps_of(config: Any) -> list[Step]:
    from dctorque_can.offline.warm_up import steps_for_service

    return steps_for_service(configuration.load(config, None))


def _all_steps(methods: list[str]) -> list[Step]:
    from dctorque_can.config.load import load_config
    from dctorque_can.offline.warm_up import steps_for_commands
    from dctorque_can.resources import shipped_config

    car = shipped_config("paper_car")
    return steps_for_commands([load_config(car, {"estimator.method": name}) for name in methods])
