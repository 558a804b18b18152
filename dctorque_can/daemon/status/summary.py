"""What a run of the service amounted to."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from dctorque_can.analysis.health import health_counts, never_received
from dctorque_can.analysis.message_faults import message_faults
from dctorque_can.analysis.status_shares import BOTH_CLUTCHES
from dctorque_can.daemon.log.counts import LogCounts
from dctorque_can.daemon.status.parts import Parts
from dctorque_can.daemon.wire.link import LinkCounts

SHARE_S = 0.1  # the end of a run takes some time too, a share of less would be of that


@dataclass(frozen=True)
class Summary:
    """What a run of the service did.

    Attributes:
        seconds: from ready to stop.
        cpu_share: processor time of the service's thread over ``seconds``, None when that is too short to tell;
            the log writer is another process.
        frames: received.
        estimates: given.
        valid_estimates: of these, with both clutch torques valid.
        status: share of the estimates with each torque valid and with each fault, see `StatusShares`.
        status_time: the same as shares of the time.
        transmission: the driving clutch against the transmission's own torque, see `TransmissionFigures`.
        never_received: mapped inputs of which no usable value came.
        missing: what did not come at all, in sentences: frames of a bus, or any that is mapped. Only of a run that
            was long enough to say so.
        published: frames sent.
        refused_ids: identifiers on which nothing is sent at the end, since someone else uses them.
        output: what was sent how evenly and what was left out, see `Publisher.as_json`; None without an output.
        stalls: how often the service did not run, and for how long at most.
        clock_steps: times the clock of the frames was set.
        link: counters of the wire, of all buses together.
        buses: each bus: its name, the number of its channel, whether it was open at the end, its counters.
        log: counters of the log, or None without one.
        health: counters of the estimator, see `health_counts`.
        messages: what was wrong with the frames of each message, see `message_faults`.
        clutch_map: what was learned of the clutches by the end, None when they are not learned.
    """

    seconds: float
    cpu_share: float | None
    frames: int
    estimates: int
    valid_estimates: int
    status: dict[str, float]
    status_time: dict[str, float]
    transmission: dict[str, float] | None
    never_received: list[str]
    missing: list[str]
    published: int
    refused_ids: list[int]
    output: dict[str, Any] | None
    stalls: dict[str, Any]
    clock_steps: int
    link: LinkCounts
    buses: list[dict[str, Any]]
    log: LogCounts | None
    health: dict[str, Any]
    messages: dict[str, dict[str, Any]]
    clutch_map: dict[str, Any] | None = None

    @classmethod
    def of(cls, parts: Parts, seconds: float, cpu_s: float, **ends: Any) -> Summary:
        """Return what a run of ``seconds`` amounted to; ``ends`` are the fields that `Parts` do not know."""
        return cls(
            seconds=round(seconds, 3),
            cpu_share=round(cpu_s / seconds, 4) if seconds >= SHARE_S else None,
            estimates=parts.shares.estimates,
            valid_estimates=parts.shares.having(BOTH_CLUTCHES),
            status=parts.shares.as_json(),
            status_time=parts.shares.time_as_json(),
            never_received=never_received(parts.config.inputs, parts.chain.health),
            **parts.output_json(),
            stalls=parts.stalls_json(),
            clock_steps=parts.clock.steps,
            link=parts.links.counts,
            log=None if parts.log is None else parts.log.counts,
            health=health_counts(parts.chain.health),
            messages=message_faults(*parts.chain.messages),
            **ends,
        )

    @property
    def complete(self) -> bool:
        """Whether every received frame is in the log (or no log was wanted)."""
        return self.log is None or (self.log.dropped == 0 and not self.log.failures)

    def as_json(self) -> dict[str, Any]:
        """Return the summary for scripts."""
        result = asdict(self)
        if self.log is not None:
            for name in ("paths", "finalised"):
                result["log"][name] = [str(path) for path in result["log"][name]]
        return result
