"""docs/output.md has every column of an estimate, every status bit and every signal on the bus."""

import re
from pathlib import Path

import pytest

from dctorque_can.bus.database import DatabaseFile, load_database
from dctorque_can.pipeline.estimates import ESTIMATE, Status
from dctorque_can.pipeline.thresholds import TIE_UP_NM

from .demo import DBC

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "output.md").read_text()
ROWS = [line for line in TEXT.splitlines() if line.startswith("|")]
MESSAGES = load_database([DatabaseFile(DBC / "dctorque.dbc")]).messages
TOLD_ONCE = re.compile(r"Dct\w+(Crc|Counter|State)|\w+Valid|RoadLoadLearned")  # of every message, in sentences


def test_every_column() -> None:
    first_cells = " ".join(row.split("|")[1] for row in ROWS)
    assert set(ESTIMATE.names or ()) <= set(re.findall(r"`(\w+)`", first_cells))


def test_every_status_bit() -> None:
    told = {}
    for row in ROWS:
        numbers, names = (re.findall(r"\w+", cell) for cell in row.split("|")[1:3])
        if numbers and all(number.isdigit() for number in numbers):
            told |= dict(zip(names, map(int, numbers), strict=True))
    assert told == {bit.name: bit.value for bit in Status}


def test_the_threshold_of_a_tie_up() -> None:
    (probability,) = [s for message in MESSAGES for s in message.signals if s.name == "TieUpProbability"]
    assert f"more than {TIE_UP_NM:g} Nm" in (probability.comment or "")
    assert f"a = {TIE_UP_NM:g} N·m" in TEXT


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
def test_every_message(message) -> None:
    start = f"| `{message.name}` | 0x{message.frame_id:X} | {message.cycle_time} ms |"
    (row,) = [row for row in ROWS if row.startswith(start)]
    told = set(re.findall(r"`(\w+)`", row.removeprefix(start)))
    if message.name == "DctStatus":
        assert told == {"EngineTorqueEstimate", "VEHICLE_FILE_IMPLAUSIBLE"}
        return
    assert told == {signal.name for signal in message.signals if not TOLD_ONCE.fullmatch(signal.name)}
