"""The parts of a service of which its status and its summary tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from dctorque_can.analysis.status_shares import StatusShares
from dctorque_can.chain import Chain
from dctorque_can.config.load import Config
from dctorque_can.daemon.clock_watch import ClockWatch
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.output.publisher import Publisher
from dctorque_can.daemon.stalls import StallWatch
from dctorque_can.daemon.status.latency import Latency
from dctorque_can.daemon.wire.links import BusLinks


@dataclass
class Parts:
    """What they are gathered from; all of it belongs to the service, which changes it.

    Attributes:
        config: that is in force.
        chain: decoder and estimator.
        links: the buses.
        publisher: sends; None without an output.
        log: the log process; None without a log.
        shares: of the status bits.
        stalls: times at which the service did not run.
        clock: steps of the system clock.
        latency: from receiving to sending.
        reloads: what became of the wishes to read the vehicle file anew, by outcome.
    """

    config: Config
    chain: Chain
    links: BusLinks
    publisher: Publisher | None
    log: LogProcess | None
    shares: StatusShares
    stalls: StallWatch
    clock: ClockWatch
    latency: Latency
    reloads: Mapping[str, int]

    def buses_json(self) -> list[dict[str, Any]]:
        """Return each bus: name, number of its channel, whether it is open, whose its times are, its counters."""
        return [
            {
                **{"name": bus.name, "number": bus.number, "open": link.up, "listen_only": bus.listen_only},
                **{"times": link.times, "filtered": link.filtered},
                **asdict(link.counts),
            }
            for bus, link in zip(self.links.buses, self.links.links, strict=True)
        ]

    def stalls_json(self) -> dict[str, Any]:
        """Return how often the service did not run, and for how long at most."""
        return {"count": self.stalls.count, "longest_s": round(self.stalls.longest_s, 3)}

    def output_json(self) -> dict[str, Any]:
        """Return what was sent, and what is refused."""
        publisher = self.publisher
        return {
            "published": self.links.counts.sent,
            "refused_ids": [] if publisher is None else sorted(publisher.refused),
            "output": None if publisher is None else publisher.as_json(),
        }
