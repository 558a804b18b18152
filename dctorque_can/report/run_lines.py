"""What a run of the service amounted to, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dctorque_can.report.clutch_map_lines import map_lines
from dctorque_can.report.message_lines import message_lines
from dctorque_can.report.status_lines import finding_lines, hint_lines, status_lines, transmission_line

_MOST_PATHS = 5  # that are told one by one
_WORTH_A_LINE = ("lost", "send_failures", "error_frames", "damaged", "dropped")


def run_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield the summary of a run (its JSON) for people, one line each."""
    share = summary["cpu_share"]
    yield (
        f"{summary['seconds']:.1f} s: {summary['frames']} frames in, {summary['estimates']} estimates, "
        f"{summary['published']} frames out" + ("" if share is None else f", {100 * share:.0f} % of one processor")
    )
    if summary["estimates"]:
        yield from status_lines(summary["status"], summary["status_time"])
    if summary["transmission"] is not None:
        yield transmission_line(summary["transmission"])
    yield from finding_lines(summary["health"]["findings"])
    yield from hint_lines(summary["health"]["hints"])
    yield from map_lines(summary["clutch_map"])
    yield from _bus_lines(summary["buses"])
    if summary["output"] is not None:
        yield from _output_lines(summary["output"])
    if summary["stalls"]["count"]:
        yield (
            f"the service did not run {summary['stalls']['count']} times, "
            f"for {summary['stalls']['longest_s']:.1f} s at most"
        )
    if summary["clock_steps"]:
        yield f"clock: the time of the frames was set {summary['clock_steps']} times"
    faults = {key: count for key, count in summary["health"].items() if count and key not in ("findings", "hints")}
    if faults:
        yield "health: " + ", ".join(f"{name} {_shown(count)}" for name, count in faults.items())
    yield from message_lines(summary["messages"])
    if (log := summary["log"]) is not None:
        missing = f"; {log['dropped']} frames missing" if log["dropped"] else ""
        yield f"log: {log['written']} frames in {_listed(log['paths'])}{missing}"
        if log["late_flushes"]:
            yield (
                f"log: {log['late_flushes']} times later with the operating system than logging.flush_ms, "
                f"{log['slowest_flush_ms']:.0f} ms after receiving at most"
            )


def _bus_lines(buses: list[Mapping[str, Any]]) -> Iterator[str]:
    several = len(buses) > 1
    for bus in buses:
        if several or any(bus[name] for name in _WORTH_A_LINE):
            state = "" if bus["open"] else "not there at the end, "
            frames = f"{bus['received']} frames, " if several else ""
            yield (
                f"{bus['name'] if several else 'bus'}: {frames}{state}lost {bus['lost']} times, "
                f"back {bus['reconnects']} times, {bus['error_frames']} error frames, {bus['bus_offs']} bus-offs, "
                f"{bus['dropped']} frames not fetched in time, {bus['damaged']} damaged lines, "
                f"{bus['send_failures']} frames not sent"
            )


def _output_lines(output: Mapping[str, Any]) -> Iterator[str]:
    """Yield what was sent how evenly, and what was not sent."""
    for can_id, foreign in output["foreign_ids"].items():
        end = "still refused" if foreign["refused"] else "sent again"
        yield (
            f"0x{can_id}: someone else sent {foreign['frames']} frames there; refused {foreign['refusals']} "
            f"times, {end} at the end"
        )
    if cycles := output["cycles"]:
        name, worst = max(cycles.items(), key=lambda item: float(item[1]["jitter_ms"]))
        yield (
            f"cycles sent: jitter at most {worst['jitter_ms']:.1f} ms ({name}, every {worst['period_ms']:g} ms, "
            f"longest {worst['longest_ms']:.1f} ms)"
        )
    if output["late"]:
        yield f"{output['late']} frames not sent, since they would have told of the past"
    if output["limited"]:
        yield f"{output['limited']} frames not sent, since they were too many"


def _listed(paths: list[str]) -> str:
    if len(paths) <= _MOST_PATHS:
        return ", ".join(paths) or "no file"
    return f"{len(paths)} files, from {paths[0]} to {paths[-1]}"


def _shown(count: object) -> str:
    if isinstance(count, dict):
        return "(" + ", ".join(f"{name} {number}" for name, number in count.items()) + ")"
    return str(count)
