"""Checksums and counters are found in frames that an encoder made, and not where there are none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dctorque_can.bus.checksum_kinds import KINDS
from dctorque_can.bus.encoder import MessageEncoder
from dctorque_can.pipeline.frames import Frames
from dctorque_can.pipeline.samples import Protection
from dctorque_can.starter.catalogue import catalogue
from dctorque_can.starter.databases import read_dbc
from dctorque_can.starter.protection import ProtectionFound, find_protection
from dctorque_can.starter.recording import Recording

PLAIN = """VERSION ""
BU_: ECU
BO_ 801 Data: 8 ECU
 SG_ Chk : 0|8@1+ (1,0) [0|255] "" ECU
 SG_ Alive : 8|4@1+ (1,0) [0|15] "" ECU
 SG_ Speed : 16|16@1+ (1,0) [0|65535] "rpm" ECU
 SG_ Other : 32|16@1+ (1,0) [0|65535] "" ECU
"""
NIBBLE = PLAIN.replace("Chk : 0|8", "Chk : 4|4")
FD = """VERSION ""
BU_: ECU
BO_ 801 Data: 12 ECU
 SG_ Chk : 0|16@1+ (1,0) [0|65535] "" ECU
 SG_ Alive : 16|8@1+ (1,0) [0|255] "" ECU
 SG_ Speed : 24|16@1+ (1,0) [0|65535] "rpm" ECU
 SG_ Other : 40|16@1+ (1,0) [0|65535] "" ECU
"""


def recorded(folder: Path, dbc: str, protection: Protection | None, n: int = 400) -> Any:
    """Return the signals of the message and a recording of it, protected so."""
    (folder / "x.dbc").write_text(dbc)
    database = read_dbc(folder / "x.dbc").database
    random = np.random.default_rng(7)
    columns = {name: random.integers(0, 65536, n).astype(np.float64) for name in ("Speed", "Other")}
    payloads = MessageEncoder(database.get_message_by_name("Data"), protection).encode(columns)
    frames = Frames.empty(n, payloads.shape[1])
    frames.t_us[:] = np.arange(n) * 10_000
    frames.can_id[:], frames.length[:], frames.data[:] = 801, payloads.shape[1], payloads
    return catalogue([database]), Recording(database, {}, frames)


@pytest.mark.parametrize(
    ("dbc", "given"),
    [
        (PLAIN, {"crc": "e2e_p01", "counter_modulus": 15, "data_id": 0x53}),
        (PLAIN, {"crc": "e2e_p01", "counter_modulus": 15, "data_id": 0x5316, "data_id_mode": "alternating"}),
        (PLAIN, {"crc": "e2e_p02", "data_ids": tuple(range(3, 243, 15))}),
        *((PLAIN, {"crc": crc}) for crc in ("crc8_j1850", "sum8", "xor8", "subaru", "toyota")),
        (PLAIN, {"crc": "crc8_j1850", "crc_start": 0, "crc_xor": 0x55}),
        (PLAIN, {"crc": "sum8", "crc_start": 77, "crc_xor": 0}),
        (NIBBLE, {"crc": "nibble_sum", "crc_start": 11, "crc_xor": 0}),
        (FD, {"crc": "e2e_p05", "counter_modulus": 256, "data_id": 0x1A2B}),
        (FD, {"crc": "hyundai_canfd", "counter_modulus": 256}),
    ],
    ids=lambda value: value.get("crc") if isinstance(value, dict) else "",
)
def test_kinds_are_found(dbc: str, given: dict[str, Any], tmp_path: Path) -> None:
    protection = Protection("Data", crc_signal="Chk", counter_signal="Alive", **given)
    found = find_protection(*recorded(tmp_path, dbc, protection))
    assert isinstance(found, ProtectionFound)
    assert found.level == "sure"
    told = {name: tuple(value) if isinstance(value, list) else value for name, value in found.fields.items()}
    modulus = told.pop("counter_modulus", KINDS[given["crc"]].modulus)
    assert (told["crc_signal"], told["counter_signal"], modulus) == (
        "Chk",
        "Alive",
        given.get("counter_modulus", 16),
    )
    expected = {name: value for name, value in given.items() if name != "counter_modulus"}
    assert {name: value for name, value in told.items() if not name.endswith("signal")} == expected


def test_a_counter_alone(tmp_path: Path) -> None:
    found = find_protection(*recorded(tmp_path, PLAIN, Protection("Data", counter_signal="Alive")))
    assert isinstance(found, ProtectionFound)
    assert found.fields == {"counter_signal": "Alive"}


def test_no_protection(tmp_path: Path) -> None:
    assert find_protection(*recorded(tmp_path, PLAIN, None)) == ""


def test_without_a_log_a_name_is_a_gap(tmp_path: Path) -> None:
    entries, _ = recorded(tmp_path, PLAIN, None)
    told = find_protection(entries, None)
    assert isinstance(told, str)
    assert "Chk, Alive: no log" in told
