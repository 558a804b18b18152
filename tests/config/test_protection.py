"""How the kinds of protection are read from a vehicle file, and what is said of mistakes."""

from collections.abc import Callable
from typing import Any, get_args

import pytest

from dctorque_can.bus.protection import CRC_KINDS, DATA_ID_MODES
from dctorque_can.config.load import Config
from dctorque_can.config.overview import input_rows
from dctorque_can.config.problems import Problem
from dctorque_can.config.protection import ProtectionSection
from dctorque_can.pipeline.samples import Protection

Load = Callable[[dict[str, Any]], Config]
Errors = Callable[[dict[str, Any]], list[Problem]]

SUM = {"crc": "sum8", "crc_signal": "EngineDataCrc"}
P01 = {"crc": "e2e_p01", "crc_signal": "EngineDataCrc", "counter_signal": "EngineDataCounter", "data_id": 256}


def test_every_key_reaches_the_decoder(load: Load) -> None:
    given = SUM | {
        **{"counter_signal": "EngineDataCounter", "counter_high_signal": "BrakeActive", "counter_modulus": 32},
        **{"crc_start": 7, "crc_xor": 9, "crc_bytes": 6},
    }
    config = load({"protection.EngineData": given, "protection.InputShafts.data_id_mode": "low"})
    assert (
        Protection(
            *("EngineData", "EngineDataCounter", 32, 3, "sum8", "EngineDataCrc"),
            **{"counter_high_signal": "BrakeActive", "crc_start": 7, "crc_xor": 9, "crc_bytes": 6},  # type: ignore[arg-type]
        )
        in config.protections
    )
    assert [p.data_id_mode for p in config.protections if p.message == "InputShafts"] == ["low"]
    speed = next(row for row in input_rows(config) if row["quantity"] == "engine_speed")
    assert speed["protection"] == ["sum8, counter"]


@pytest.mark.parametrize(
    ("kind", "modulus"), [("honda", 4), ("e2e_p11", 15), ("vw_mqb", 16), ("toyota", 16), ("none", 16)]
)
def test_the_counter_of_a_kind(kind: str, modulus: int) -> None:
    assert ProtectionSection(crc=kind).modulus == modulus  # type: ignore[arg-type]


def test_kinds_and_modes_are_those_of_the_decoder() -> None:
    fields = ProtectionSection.model_fields
    assert get_args(fields["crc"].annotation) == CRC_KINDS
    assert get_args(fields["data_id_mode"].annotation) == DATA_ID_MODES


@pytest.mark.parametrize(
    ("protection", "key", "reason"),
    [
        (P01 | {"crc": "sum_8"}, "crc", "must be one of: none, crc8_j1850, e2e_p01"),
        (SUM | {"crc": "nibble_sum"}, "crc_signal", "has 8 bits; nibble_sum has 4"),
        (SUM | {"crc": "toyota", "crc_signal": "EngineDataCounter"}, "crc_signal", "a CRC is one whole byte"),
        (SUM | {"crc": "toyota", "crc_start": 1}, "crc_start", "cannot be chosen with toyota; it can with crc8"),
        (SUM | {"crc_start": 256}, "crc_start", "must be less than or equal to 255"),
        (SUM | {"crc_bytes": 9}, "crc_bytes", "are 9 bytes; the message has 8"),
        (SUM | {"crc_bytes": 0}, "crc_bytes", "must be greater than or equal to 1"),
        (SUM | {"crc_high_signal": "BrakeActive"}, "crc_signal", "is one of two parts"),
        (P01 | {"data_id": 65536}, "data_id", "it has 16 bits, 0..65535"),
        (P01 | {"data_id_mode": "nibble", "data_id": 4096}, "data_id", "it has 12 bits, 0..4095"),
        (P01 | {"data_id_mode": "1C"}, "data_id_mode", "must be one of: both, low, alternating or nibble"),
        (SUM | {"data_id_mode": "low"}, "data_id_mode", "belongs to e2e_p01 and e2e_p11"),
        (SUM | {"counter_high_signal": "BrakeActive"}, "counter_high_signal", "counter_signal has the lower ones"),
        (P01 | {"counter_high_signal": "BrakeActiv"}, "counter_high_signal", "did you mean BrakeActive?"),
        (
            {"crc": "vw_mqb", "crc_signal": "EngineDataCrc", "counter_signal": "EngineDataCounter"},
            "data_ids",
            "are missing, and those of EngineData are not known; known are ESP_02",
        ),
        (P01 | {"crc": "vw_mqb", "data_ids": [1, 2]}, "data_ids", "at least 16 items"),
        (SUM | {"crc": "vw_mqb", "data_ids": [1] * 16}, "counter_signal", "missing: vw_mqb has an alive counter"),
    ],
)
def test_a_protection_that_is_wrong(errors: Errors, protection: dict[str, Any], key: str, reason: str) -> None:
    (problem,) = errors({"protection.EngineData": protection})
    assert problem.key == f"protection.EngineData.{key}"
    assert reason in str(problem)


def test_all_mistakes_of_a_protection_are_told_at_once(errors: Errors) -> None:
    wrong = {"crc": "e2e_p05", "crc_signal": "EngineDataCrc", "counter_signal": "EngineDataCounter"}
    told = {problem.key: problem.reason for problem in errors({"protection.EngineData": wrong})}
    assert told.keys() == {f"protection.EngineData.{key}" for key in ("crc_signal", "counter_signal", "data_id")}
    assert "the CRC of e2e_p05 is 2 whole bytes, little_endian (@1)" in told["protection.EngineData.crc_signal"]
    assert (
        told["protection.EngineData.counter_signal"]
        == "has 4 bits and the modulus 256; e2e_p05 has 8 bits and 256"
    )
    assert told["protection.EngineData.data_id"] == "missing: e2e_p05 needs the data id of the message"


@pytest.mark.parametrize(
    ("protection", "key"), [(SUM | {"data_id": 5}, "data_id"), (P01 | {"data_ids": [1] * 16}, "data_ids")]
)
def test_a_key_without_effect_is_told(load: Load, protection: dict[str, Any], key: str) -> None:
    (warning,) = load({"protection.EngineData": protection}).warnings
    assert warning.key == f"protection.EngineData.{key}"
    assert warning.reason == f"has no effect with crc: {protection['crc']}"
