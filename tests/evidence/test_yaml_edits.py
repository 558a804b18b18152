"""Values of a YAML text changed in place, by hand."""

import pytest

from dctorque_can.config.document import parse
from dctorque_can.evidence.yaml_edits import Edit, edited, old_value

TEXT = """\
# a car
vehicle:   # all SI
  mass_kg: 14000          # weighed
  gears:
    1: &gear {shaft: 1, ratio: 3.78}
    2: *gear
    3: {<<: *gear, ratio: 1.43}
inputs:
  engine_speed: EngineData.EngineSpeed
  engine_torque:
    signal: EngineData.EngineTorque
    range: [-500,
            1000]
  sum: [{signal: A.b}, A.c]
gears:
  shaft1:
    values:
      0: neutral   # none
      1: 1
  last: end
"""


def change(key, value):
    changed = edited(TEXT, [Edit(key, value, "why")])
    document = parse(changed.encode(), "car.yaml")
    assert document.problems == []
    return changed, document.value(tuple(int(s) if s.isdigit() else s for s in key.split(".")))


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("vehicle.mass_kg", "1410", "  mass_kg: 1410          # weighed; why"),
        ("vehicle.gears.3.ratio", "1.39", "    3: {<<: *gear, ratio: 1.39}  # why"),
        ("vehicle.gears.3.final_drive", "4", "    3: {final_drive: 4, <<: *gear, ratio: 1.43}  # why"),
        ("vehicle.gears.2.ratio", "2.18", "    2: {<<: *gear, ratio: 2.18}  # why"),
        (
            "inputs.engine_speed.delay_ms",
            "15",
            "  engine_speed: {signal: EngineData.EngineSpeed, delay_ms: 15}  # why",
        ),
        ("inputs.engine_torque.factor", "-1", "    factor: -1  # why"),
        ("inputs.sum.1.factor", "2", "  sum: [{signal: A.b}, {signal: A.c, factor: 2}]  # why"),
        ("vehicle.chassis.wheel_radius_m", "0.3", "  chassis: {wheel_radius_m: 0.3}  # why"),
    ],
)
def test_one_line_changes(key, value, line):
    changed, found = change(key, value)
    assert found == parse(f"x: {value}".encode(), "").data["x"]
    lines, before = changed.splitlines(), TEXT.splitlines()
    assert line in lines
    added = len(lines) - len(before)
    assert len(set(before) - set(lines)) <= 1 - added
    assert added in (0, 1)


def test_a_block_becomes_one_line():
    changed, found = change("gears.shaft1.values", "{0: neutral, 1: 3}")
    assert found == {0: "neutral", 1: 3}
    assert "  last: end\n" in changed


def test_what_shares_an_anchor_stays():
    """Gear 2 is an alias of gear 1: what is changed of the one is no change of the other."""
    changed, found = change("vehicle.gears.1.ratio", "3.5")
    gears = parse(changed.encode(), "").data["vehicle"]["gears"]
    assert found == 3.5
    assert gears[2] == {"shaft": 1, "ratio": 3.78}
    assert gears[3] == {"shaft": 1, "ratio": 1.43}


def test_several_changes_and_old_values():
    edits = [Edit("vehicle.gears.3.ratio", "1.4", "one"), Edit("vehicle.gears.3.shaft", "2", "two")]
    assert "    3: {shaft: 2, <<: *gear, ratio: 1.4}  # one; two" in edited(TEXT, edits).splitlines()
    assert old_value(TEXT, "vehicle.mass_kg") == "14000"
    assert old_value(TEXT, "inputs.engine_torque.range") == "[-500, 1000]"
    assert old_value(TEXT, "vehicle.gears.9.ratio") is None
