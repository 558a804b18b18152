"""The other end of the status socket: reads one snapshot of a service that runs."""

from __future__ import annotations

import json
import socket
import time
from pathlib import Path
from typing import Any

from dctorque_can.daemon.status.listener import SOCKET_NAME
from dctorque_can.errors import DctorqueError

RUNTIME = Path("/run/dctorque")  # where systemd makes a folder for each instance of the unit
TIMEOUT_S = 5.0
LONGEST_ANSWER = 4 << 20
_BUSY = "too many clients at the moment; try again"


def socket_of(name: str | None, runtime: Path = RUNTIME) -> Path:
    """Return the socket of a service under systemd, by the name of its instance; of the only one without a name.

    Raises:
        DctorqueError: there is none, or several, or the name is a path.
    """
    if name is not None:
        if "/" in name or name in ("", ".", ".."):
            raise DctorqueError(f"{name}: the name of an instance is expected; a path goes behind --socket")
        return runtime / name / SOCKET_NAME
    found = sorted(runtime.glob(f"*/{SOCKET_NAME}"))
    if len(found) != 1:
        names = ", ".join(path.parent.name for path in found)
        what = f"several services run ({names}): say which" if found else f"no service has a socket in {runtime}"
        raise DctorqueError(f"{what}; a socket elsewhere goes behind --socket (`dctorque run --status PATH`)")
    return found[0]


def read_status(path: Path, timeout_s: float = TIMEOUT_S) -> dict[str, Any]:
    """Return the latest snapshot of the service that serves at ``path``.

    Raises:
        DctorqueError: nobody serves there, or what comes is no status.
    """
    limit = time.monotonic() + timeout_s
    content = bytearray()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        try:
            client.settimeout(timeout_s)
            client.connect(str(path))
            while chunk := client.recv(1 << 16):
                content += chunk
                client.settimeout(max(limit - time.monotonic(), 0.001))
                if len(content) > LONGEST_ANSWER:
                    raise DctorqueError(f"{path}: sends more than any status is long: no service serves there")
        except TimeoutError as error:
            raise DctorqueError(f"{path}: no answer for {timeout_s:g} s") from error
        except OSError as error:
            raise DctorqueError(f"{path}: {_why(error)}") from error
    if not content:
        raise DctorqueError(f"{path}: {_BUSY}")
    try:
        status = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DctorqueError(f"{path}: what comes is no status ({error})") from error
    if not isinstance(status, dict) or "clients" not in status:
        raise DctorqueError(f"{path}: what comes is no status")
    if "uptime_s" not in status:
        raise DctorqueError(f"{path}: the service starts and has no status yet; try again")
    return status


def _why(error: OSError) -> str:
    if isinstance(error, FileNotFoundError):
        return "no such socket: does the service run, with `--status` or under systemd?"
    if isinstance(error, ConnectionRefusedError):
        return "nobody serves there any more: the service was killed or is being started"
    if isinstance(error, BlockingIOError):
        return _BUSY
    if isinstance(error, PermissionError):
        return "Permission denied: root may read it, and the user and the group of the service"
    return error.strerror or str(error)
