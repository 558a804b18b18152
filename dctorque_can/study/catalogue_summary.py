"""What all runs of a catalogue say: by car, drive and kind of signals, and which ask for too much trust."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dctorque_can.analysis.errors import TORQUES
from dctorque_can.study.catalogue import Catalogue
from dctorque_can.study.catalogue_smoothed import Smoothing, smoothing
from dctorque_can.study.run import Record

MOST_WRONG_MS = 50.0
"""For so long at most may a torque be confidently wrong on a drive."""
LEAST_HELD = 0.90
"""So many at least of the valid estimates of each draw the 95 % band is to hold."""
LEAST_HELD_POOLED = 0.97
"""… and of those of all drives."""


@dataclass(frozen=True, slots=True)
class TorqueFigures:
    """One torque over the draws of one drive.

    Attributes:
        wrong_ms: for how long it was confidently wrong in the worst draw.
        rms_nm: RMS error of the valid estimates of all draws; None when there are none.
        held: share of these within the 95 % band; likewise.
        held_least: … in the worst draw.
        valid: mean share of valid estimates.
        episode: the longest stretch of all draws in which it was confidently wrong, with its draw; or None.
    """

    wrong_ms: float
    rms_nm: float | None
    held: float | None
    held_least: float | None
    valid: float
    episode: dict[str, float] | None

    @property
    def asks_too_much(self) -> bool:
        """Whether more trust is asked for than is due."""
        return self.wrong_ms > MOST_WRONG_MS or (self.held_least is not None and self.held_least < LEAST_HELD)


@dataclass(frozen=True, slots=True)
class Row:
    """One drive of one car with one kind of signals."""

    vehicle: str
    drive: str
    signals: str
    draws: int
    torques: dict[str, TorqueFigures]


@dataclass(frozen=True)
class CatalogueSummary:
    """Figures of a whole catalogue.

    Attributes:
        catalogue: what was done.
        rows: in the order of the study.
        pooled: by torque, the share of all valid estimates within the 95 % band; None when there are none.
        failed: run to its reason.
        smoothing: by torque, what smoothing makes of the estimates; empty unless it was asked for.
    """

    catalogue: Catalogue
    rows: list[Row]
    pooled: dict[str, float | None]
    failed: dict[int, str]
    smoothing: dict[str, Smoothing]

    def beyond(self) -> Iterator[tuple[Row, str]]:
        """Yield rows with the torques that ask for too much trust, see `TorqueFigures.asks_too_much`."""
        for row in self.rows:
            yield from ((row, name) for name, figures in row.torques.items() if figures.asks_too_much)

    def as_json(self) -> dict[str, Any]:
        """Return the summary for scripts."""
        plan = self.catalogue.plan
        return {
            "study": str(self.catalogue.path),
            "profile": plan.profile,
            "runs": plan.runs,
            "seed": plan.seed,
            "identity": self.catalogue.identity(),
            "failed": [{"run": run, "error": error} for run, error in self.failed.items()],
            "held": self.pooled,
            "beyond": [
                {"vehicle": row.vehicle, "drive": row.drive, "signals": row.signals, "torque": name}
                for row, name in self.beyond()
            ],
            "rows": [asdict(row) for row in self.rows],
            "smoothing": {name: asdict(one) for name, one in self.smoothing.items()},
        }

    def write(self, path: Path) -> None:
        """Write the summary as a file for scripts."""
        text = json.dumps(self.as_json(), indent=2, allow_nan=False, ensure_ascii=False)
        path.write_text(text + "\n", encoding="utf-8")


def summarise_catalogue(catalogue: Catalogue, records: Mapping[int, Record]) -> CatalogueSummary:
    """Return the figures of a catalogue, all runs of which must be there."""
    grouped: dict[tuple[str, str, str], list[Record]] = {}
    failed: dict[int, str] = {}
    for number, case in catalogue.cases().items():
        record = records[number]
        if "error" in record:
            failed[number] = f"{case.vehicle}, {case.drive}, {case.signals}: {record['error']}"
        else:
            grouped.setdefault((case.vehicle, str(case.drive), case.signals), []).append(record)
    rows = [
        Row(*names, len(found), {name: _torque(name, found) for name in TORQUES})
        for names, found in grouped.items()
    ]
    good = [record for found in grouped.values() for record in found]
    pooled = {name: _mean(name, "held", good) for name in TORQUES}
    return CatalogueSummary(catalogue, rows, pooled, failed, smoothing(good))


def _torque(name: str, records: Sequence[Record]) -> TorqueFigures:
    torques = [record["torques"][name] for record in records]
    squares = _mean(name, "rms_nm", records, 2.0)
    longest = max(records, key=lambda record: float((record["torques"][name]["episode"] or _NONE)["wrong_ms"]))
    episode = longest["torques"][name]["episode"]
    return TorqueFigures(
        wrong_ms=max(torque["wrong_ms"] for torque in torques),
        rms_nm=None if squares is None else float(np.sqrt(squares)),
        held=_mean(name, "held", records),
        held_least=min((torque["held"] for torque in torques if torque["rows"]), default=None),
        valid=float(np.mean([torque["valid"] for torque in torques])),
        episode=None if episode is None else episode | {"draw": longest["case"]["draw"]},
    )


_NONE = {"wrong_ms": 0.0}


def _mean(name: str, figure: str, records: Sequence[Record], power: float = 1.0) -> float | None:
    """Return the mean over all valid estimates of a figure to a power."""
    torques = [t for record in records if (t := record["torques"][name])["rows"]]
    rows = sum(torque["rows"] for torque in torques)
    return sum(torque["rows"] * torque[figure] ** power for torque in torques) / rows if rows else None
