"""docs/configuration.md has a row for every key, with the default and the words of the model."""

import re
from pathlib import Path
from typing import get_args

import pytest
import yaml
from pydantic import TypeAdapter
from pydantic.fields import FieldInfo

from dctorque_can.bus.checksum_kinds import KINDS
from dctorque_can.bus.protection import CRC_KINDS
from dctorque_can.bus.vw_mqb import DATA_IDS
from dctorque_can.config import clutch_map, edges, estimation, inputs, protection, signals, vehicle
from dctorque_can.config.descriptions import field_descriptions
from dctorque_can.config.load import OPTIONAL_SECTIONS, SECTIONS
from dctorque_can.config.section import Section
from dctorque_can.resources import shipped_dbc

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "configuration.md").read_text()
MODELS = [
    model
    for module in (vehicle, signals, inputs, protection, estimation, clutch_map, edges)
    for model in vars(module).values()
    if isinstance(model, type) and issubclass(model, Section) and model.__module__ == module.__name__
]
SOURCES = {"source"}  # one of several sections: told in a sentence
PARTS = {"shaft1", "shaft2", "clutch1", "clutch2", "both"}


def default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None or value in ({}, "") or isinstance(value, Section):
        return "–"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_key_is_in_the_reference(model: type[Section]) -> None:
    for name, field in model.model_fields.items():
        if name in SOURCES | PARTS:
            assert f"`{name}`" in TEXT or f"`{name}: " in TEXT
            continue
        meaning = field_descriptions(model).get(name, "").replace("``", "`").strip().rstrip(".")
        assert meaning, f"{model.__name__}.{name} has no description"
        assert f"| `{name}` | {default(field)} | {meaning} |" in TEXT


def test_every_section_is_in_the_reference() -> None:
    for section in SECTIONS:
        assert f"| `{section}` | yes |" in TEXT
    for section in OPTIONAL_SECTIONS:
        assert f"| `{section}` | no |" in TEXT
    for quantity, (lowest, highest) in inputs.PLAUSIBLE.items():
        assert f"| `{quantity.name.lower()}` | {lowest:g} | {highest:g} |" in TEXT


def test_every_kind_of_checksum_is_in_the_reference() -> None:
    (kinds,) = [get_args(protection.ProtectionSection.model_fields["crc"].annotation)]
    assert kinds == CRC_KINDS
    table = TEXT[TEXT.index("### Kinds of checksum") : TEXT.index("## `gears`")]
    rows = dict(re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", table, re.MULTILINE))
    assert rows.keys() == set(kinds)
    for name, kind in KINDS.items():
        if name != "e2e_p11":  # as the other one
            assert re.match(rf"{kind.bits}\b", rows[name])
            assert ("`data_id`" in rows[name]) == (kind.data_id_bits > 0)
    known = re.findall(r"`(\w+)`", table[table.index("are known, by") : table.index("Those of others")])
    assert set(known) == DATA_IDS.keys()


def test_examples_in_the_reference_are_accepted(load) -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
    assert len(blocks) == 11
    database = {"databases.0.file": str(shipped_dbc("demo_car_one_gear"))}
    for block in blocks:
        for key, value in yaml.safe_load(block).items():
            if key == "gears":
                reverse = {"shaft": 2, "ratio": 3.5, "final_drive": 3.7, "inertia_kgm2": 0.001}
                assert load(database | {"gears": value, "vehicle.gears.R": reverse}).warnings == ()
            elif key == "vehicle":
                others = {
                    n: {"shaft": 2 - n % 2, "ratio": 4.5 / n, "final_drive": 4.44} for n in (3, 4, 5)
                }  # of the demo car's bus
                assert load({"vehicle": value | {"gears": value["gears"] | others}}).warnings == ()
            elif key == "protection":
                model = TypeAdapter(dict[str, protection.ProtectionSection])
                assert all(list(part.contradictions()) == [] for part in model.validate_python(value).values())
            elif key == "clutch_phase":
                assert load(database | {key: value}).warnings == ()
            else:
                section = inputs.InputsSection.model_fields[key].annotation
                assert list(TypeAdapter(section).validate_python(value).contradictions()) == []
