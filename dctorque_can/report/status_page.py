"""The status of a running service for people, in lines of at most 80 columns."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from dctorque_can.analysis.errors import VALID
from dctorque_can.analysis.status_shares import FAULTS, key_of
from dctorque_can.report.message_lines import message_lines
from dctorque_can.report.torque_table import TORQUE_NAMES

WIDTH = 80
HANGS_S = 5.0
_LABEL = 10
_COUNTED = ("gap_resets", "clock_resets", "numeric_resets", "late_frames")


def status_page(status: Mapping[str, Any]) -> list[str]:
    """Return a snapshot (`daemon.status.live.LiveStatus`) as lines."""
    lines = []
    for label, text in _items(status):
        lines += textwrap.wrap(
            text,
            WIDTH,
            initial_indent=label.ljust(_LABEL),
            subsequent_indent=" " * _LABEL,
            break_on_hyphens=False,
        ) or [label]
    return lines


def _items(status: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield a label and a text for each thing worth telling."""
    age_s = float(status["snapshot_age_s"])
    if age_s > HANGS_S:
        yield "HANGS", f"the service has told nothing for {_duration(age_s)}; what follows is of then"
    yield (
        "service",
        f"{status['name']}: {status['state']}, for {_duration(status['uptime_s'])}; version {status['version']}, "
        f"process {status['pid']}, {status['memory_mb']:.0f} MB"
        + ("" if status["cpu_share"] is None else f", {100 * status['cpu_share']:.0f} % of one processor"),
    )
    configuration = status["configuration"]
    reloads = ", ".join(f"{n} {outcome}" for outcome, n in configuration["reloads"].items() if n)
    yield (
        "file",
        f"{configuration['file']} {configuration['vehicle_digest'][:12]}, DBCs "
        f"{configuration['database_digest'][:12]}" + (f"; read anew: {reloads}" if reloads else ""),
    )
    rates = status["rates_hz"]
    yield (
        "now",
        f"{rates['frames']:.0f} frames/s in, {rates['estimates']:.0f} estimates/s, {rates['published']:.0f} "
        "frames/s out",
    )
    yield (
        "in all",
        f"{status['frames']} frames in, {status['estimates']} estimates, {status['published']} frames out",
    )
    yield "latency", _latency(status["latency"])
    yield from _torques(status["status_time"])
    yield from _buses(status["buses"])
    yield "messages", _messages(status["messages"])
    for line in message_lines(status["message_faults"]):
        yield "bad frames", line
    yield from _output(status)
    yield from _health(status["health"])
    if status["stalls"]["count"]:
        stalls = status["stalls"]
        yield "stalls", f"did not run {stalls['count']} times, for {stalls['longest_s']:.1f} s at most"
    if status["clock_steps"]:
        yield "clock", f"the time of the frames was set {status['clock_steps']} times"
    yield from _log(status["log"])
    clients = status["clients"]
    if dropped := {name: n for name, n in clients.items() if n and name != "answered"}:
        yield "clients", ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in dropped.items())


def _latency(latency: Mapping[str, Any]) -> str:
    foreign = latency["foreign_clock"]
    other = f"; {foreign} frames with stamps of another clock" if foreign else ""
    if not latency["count"]:
        return f"not known yet{other}"
    return "receive to send " + _quantiles(latency) + f"; last minute {_quantiles(latency['last_minute'])}{other}"


def _quantiles(times: Mapping[str, Any]) -> str:
    if not times["count"]:
        return "–"
    numbers = "/".join(f"{times[key]:.3g}" for key in ("p50_ms", "p99_ms", "p99.9_ms", "longest_ms"))
    return f"{numbers} ms (p50/p99/p99.9/max)"


def _torques(shares: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    valid = ", ".join(f"{TORQUE_NAMES[name]} {100 * shares[key_of(bit)]:.1f} %" for name, bit in VALID.items())
    yield "valid", f"{valid} of the time"
    faults = {key_of(bit).replace("_", " "): shares[key_of(bit)] for bit in FAULTS if shares[key_of(bit)]}
    if faults:
        yield "faults", ", ".join(f"{name} {100 * share:.1f} %" for name, share in faults.items()) + " of the time"


def _buses(buses: list[Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    for bus in buses:
        told = (
            "error_frames",
            "bus_offs",
            "dropped",
            "damaged",
            "lost",
            "reconnects",
            "silences",
            "send_failures",
        )
        counts = ", ".join(f"{bus[name]} {name.replace('_', ' ')}" for name in told if bus[name])
        state = ("open" if bus["open"] else "AWAY") + (", listening only" if bus["listen_only"] else "")
        yield (
            "bus",
            f"{bus['name']}: {state}, {bus['received']} in, {bus['sent']} out" + (counts and f"; {counts}"),
        )


def _messages(messages: list[Mapping[str, Any]]) -> str:
    """Return how long ago each message told something; those that never did first."""
    told = sorted(messages, key=lambda each: (each["age_s"] is not None, each["name"]))
    return ", ".join(
        f"{each['name']} " + ("never" if each["age_s"] is None else _duration(each["age_s"])) for each in told
    )


def _output(status: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    output = status["output"]
    if output is None:
        return
    for can_id, foreign in output["foreign_ids"].items():
        state = "REFUSED" if foreign["refused"] else "sent again"
        yield "foreign", f"0x{can_id}: {foreign['frames']} frames of somebody else, {state}"
    if cycles := output["cycles"]:
        name, worst = max(cycles.items(), key=lambda item: float(item[1]["jitter_ms"]))
        yield "cycles", f"jitter at most {worst['jitter_ms']:.1f} ms ({name}, every {worst['period_ms']:g} ms)"
    if output["late"] or output["limited"]:
        yield "not sent", f"{output['late']} of the past, {output['limited']} too many"


def _health(health: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    resets = ", ".join(f"{health[name]} {name.replace('_', ' ')}" for name in _COUNTED if health[name])
    if resets:
        yield "resets", resets
    for reason, counts in health.items():
        if isinstance(counts, dict) and counts:
            yield "inputs", f"{reason.replace('_', ' ')}: " + ", ".join(f"{q} {n}" for q, n in counts.items())
    for finding in health["findings"]:
        yield "finding", finding["says"] + ("" if finding["stands"] else " [no longer so]")


def _log(log: Mapping[str, Any] | None) -> Iterator[tuple[str, str]]:
    if log is None:
        yield "log", "none"
        return
    told = ("dropped", "restarts", "deleted", "finalised", "late_flushes")
    counts = ", ".join(f"{log[name]} {name.replace('_', ' ')}" for name in told if log[name])
    files = f"{log['opened']} file" + ("" if log["opened"] == 1 else "s")
    yield "log", f"{log['written']} frames written, {files}" + (counts and f"; {counts}")
    for file in log["files"]:
        yield "", f"{file['bytes'] / 1e6:.1f} MB {file['path']}"
    for failure in log["failures"]:
        yield "", f"failed: {failure}"


def _duration(seconds: float) -> str:
    """Return a time for people: 0.35 s, 12 s, 5 min, 3.2 h, 12 d."""
    for unit, size in (("d", 86_400.0), ("h", 3_600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s" if seconds >= 10 else f"{seconds:.2f} s"
