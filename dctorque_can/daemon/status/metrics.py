"""The status as text for Prometheus: exposition format 0.0.4, which tests read with Prometheus' own library.

Only the standard library is imported: the status process has it alone. What has names of its own in the status
(buses, messages, quantities, faults) becomes a label.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
PREFIX = "dctorque_"

Labels = Mapping[str, str]
Sample = tuple[str, Labels, float]

_BUS = {
    "received": "frames_received",
    "error_frames": "error_frames",
    "bus_offs": "bus_offs",
    "dropped": "frames_dropped_by_kernel",
    "damaged": "frames_damaged",
    "lost": "bus_lost",
    "reconnects": "bus_reconnects",
    "sent": "frames_sent",
    "send_failures": "send_failures",
}
_LOG = {
    "written": "log_frames_written",
    "dropped": "log_frames_dropped",
    "restarts": "log_process_restarts",
    "deleted": "log_files_deleted",
    "late_flushes": "log_late_flushes",
    "opened": "log_files_opened",
}
_QUANTILES = {"p50_ms": "0.5", "p99_ms": "0.99", "p99.9_ms": "0.999"}
_HELP = {
    "up": "1 while the service hands over its status.",
    "info": "Version and configuration, as labels.",
    "uptime_seconds": "Since the service was ready.",
    "snapshot_age_seconds": "Since the service handed over its status; more than a few seconds: it hangs.",
    "memory_bytes": "Of the service in RAM, without its log and status processes.",
    "cpu_share": "Processor time of the service's thread over time, since the start.",
    "frames_received_total": "Frames of any kind, by bus.",
    "estimates_total": "Estimates given.",
    "valid_estimates_total": "Estimates with both clutch torques valid.",
    "bus_up": "1 while the bus is open.",
    "message_age_seconds": "Since the message told a value that could be used.",
    "status_time_ratio": "Share of the time with each torque valid, and with each fault.",
    "latency_seconds": "From the time stamp of a frame to its answer, since the start.",
    "latency_longest_seconds": "The longest of these.",
    "stalls_total": "Times the service did not run for more than 0.5 s.",
    "clock_steps_total": "Times the clock of the frames was set.",
    "identifiers_refused": "Identifiers of ours on which somebody else sends at the moment.",
    "finding_stands": "1 while a finding about the vehicle file stands.",
    "input_faults_total": "Values that were not used, by input and reason.",
    "log_bytes": "Of the latest log file.",
    "reloads_total": "Wishes to read the vehicle file anew, by outcome.",
    "status_clients_total": "Clients of the status, by what became of them.",
}


def metrics_text(status: Mapping[str, Any]) -> str:
    """Return a snapshot of the status as text for Prometheus; without a snapshot, that the service is not up."""
    lines: list[str] = []
    known = ""
    for name, labels, value in _samples(status):
        family = name.removesuffix("_sum").removesuffix("_count")
        if family != known:
            known = family
            kind = (
                "counter" if family.endswith("_total") else "summary" if family == "latency_seconds" else "gauge"
            )
            words = _HELP.get(family) or family.removesuffix("_total").replace("_", " ").capitalize() + "."
            lines += [f"# HELP {PREFIX}{family} {words}", f"# TYPE {PREFIX}{family} {kind}"]
        lines.append(f"{PREFIX}{name}{_shown(labels)} {value!r}")
    return "\n".join(lines) + "\n"


def _samples(status: Mapping[str, Any]) -> Iterator[Sample]:
    """Yield all samples, those of one family behind each other."""
    yield "up", {}, int("uptime_s" in status)
    for outcome, n in status.get("clients", {}).items():
        yield "status_clients_total", {"outcome": outcome}, n
    if "uptime_s" not in status:
        return
    configuration = status["configuration"]
    words = ("vehicle_digest", "database_digest")
    yield (
        "info",
        {"version": status["version"], "name": status["name"], **{word: configuration[word] for word in words}},
        1,
    )
    yield "uptime_seconds", {}, status["uptime_s"]
    yield "snapshot_age_seconds", {}, status["snapshot_age_s"]
    yield "memory_bytes", {}, round(1e6 * status["memory_mb"])
    if status["cpu_share"] is not None:
        yield "cpu_share", {}, status["cpu_share"]
    yield "estimates_total", {}, status["estimates"]
    yield "valid_estimates_total", {}, status["valid_estimates"]
    yield "stalls_total", {}, status["stalls"]["count"]
    yield "clock_steps_total", {}, status["clock_steps"]
    yield "identifiers_refused", {}, len(status["refused_ids"])
    for outcome, n in configuration["reloads"].items():
        yield "reloads_total", {"outcome": outcome}, n
    yield from _of_buses(status["buses"])
    yield from _of_inputs(status)
    yield from _of_latency(status["latency"])
    if status["log"] is not None:
        yield from _of_log(status["log"])


def _of_buses(buses: list[Mapping[str, Any]]) -> Iterator[Sample]:
    for bus in buses:
        yield "bus_up", {"bus": bus["name"]}, int(bus["open"])
    for key, name in _BUS.items():
        for bus in buses:
            yield f"{name}_total", {"bus": bus["name"]}, bus[key]


def _of_inputs(status: Mapping[str, Any]) -> Iterator[Sample]:
    for message in status["messages"]:
        if message["age_s"] is not None:
            channel = "" if message["channel"] is None else str(message["channel"])
            labels = {"message": message["name"], "id": message["id"], "channel": channel}
            yield "message_age_seconds", labels, message["age_s"]
    for name, share in status["status_time"].items():
        yield "status_time_ratio", {"status": name}, share
    health = status["health"]
    for reason, counts in health.items():
        if isinstance(counts, dict):
            for quantity, n in counts.items():
                yield "input_faults_total", {"input": quantity, "reason": reason}, n
    for reason, n in health.items():
        if isinstance(n, int):
            yield f"{reason}_total", {}, n
    for finding in health["findings"]:
        yield "finding_stands", {"finding": finding["finding"], "key": finding["key"]}, int(finding["stands"])


def _of_latency(latency: Mapping[str, Any]) -> Iterator[Sample]:
    for key, quantile in _QUANTILES.items():
        if latency[key] is not None:
            yield "latency_seconds", {"quantile": quantile}, _seconds(latency[key])
    yield "latency_seconds_sum", {}, latency["sum_s"]
    yield "latency_seconds_count", {}, latency["count"]
    if latency["longest_ms"] is not None:
        yield "latency_longest_seconds", {}, _seconds(latency["longest_ms"])


def _of_log(log: Mapping[str, Any]) -> Iterator[Sample]:
    for key, name in _LOG.items():
        yield f"{name}_total", {}, log[key]
    if log["files"]:
        yield "log_bytes", {}, log["files"][-1]["bytes"]


def _seconds(milliseconds: float) -> float:
    return round(1e-3 * milliseconds, 9)


def _shown(labels: Labels) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items()) + "}"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n").replace('"', '\\"')
