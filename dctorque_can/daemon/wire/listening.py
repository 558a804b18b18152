"""Buses that are only listened to: python-can may not send on them, and the hardware is silent where it can be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

import can

HARDWARE: dict[str, Mapping[str, Any]] = {
    "cantact": {"monitor": True},
    "kvaser": {"driver_mode": False, "single_handle": True},
    "nixnet": {"listen_only": True},
    "pcan": {"state": can.BusState.PASSIVE},
    "seeedstudio": {"operation_mode": "silent"},
    "slcan": {"listen_only": True},
    "systec": {"state": can.BusState.PASSIVE},
    "vector": {"listen_only": True},
}
"""Arguments by which python-can opens a controller that neither sends nor acknowledges."""
_WITHOUT_A_CONTROLLER = ("virtual",)


class ListenOnlyError(can.CanOperationError):
    """Something would be sent on a bus that is only listened to."""


def listening(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments of ``can.Bus`` with those that silence the hardware; what is given already stays."""
    return dict(HARDWARE.get(arguments["interface"], {})) | dict(arguments)


def forbid_sending(bus: can.BusABC) -> None:
    """Let every way of sending on ``bus`` raise."""

    def refuse(*arguments: object, **named: object) -> NoReturn:
        raise ListenOnlyError(f"{bus.channel_info} is only listened to")

    bus.send = refuse  # type: ignore[method-assign]
    bus.send_periodic = refuse  # type: ignore[method-assign]
    bus._send_periodic_internal = refuse  # type: ignore[method-assign]


def remark(interface: str, channel: str) -> str | None:
    """Return what the hardware does on a bus that is only listened to, where it is not silent too."""
    if interface in HARDWARE or interface in _WITHOUT_A_CONTROLLER:
        return None
    still = f"{interface}:{channel}: nothing is sent, but its controller acknowledges the frames of others"
    if interface == "socketcan":
        return f"{still} unless it was set up by `ip link set {channel} type can listen-only on`"
    return f"{still}: python-can has no listen-only mode for this interface"
