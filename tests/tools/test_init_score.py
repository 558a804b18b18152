"""`tools/init-score`: proposals are counted against a truth."""

import runpy
from pathlib import Path

import yaml

from dctorque_can.starter.databases import read_dbc
from dctorque_can.starter.propose import propose

ROOT = Path(__file__).parents[2]
TOOL = runpy.run_path(str(ROOT / "tools" / "init-score"))


def test_a_truth_gives_the_signals_of_each_key() -> None:
    truth = yaml.safe_load((ROOT / "tools" / "init_truths" / "hyundai_can.yaml").read_text())
    expected = TOOL["expected"](truth)
    assert expected["inputs.engine_torque"] == {"EMS11.TQI", "EMS11.TQFR", "EMS12.TQ_STND"}
    assert expected["inputs.wheel_speeds.rl"] == {"WHL_SPD11.WHL_SPD_RL"}
    assert "clutch_phase.source" not in expected


def test_what_is_right_and_what_is_not_are_counted() -> None:
    """Of the demo car without a log: its wheels are sure, so a truth that has others makes them wrong and sure."""
    starter = propose([read_dbc(ROOT / "dbc" / "demo_car.dbc")], None)
    found = {each.key: {entry.name for entry in each.entries} for each in starter.proposals}
    all_right = TOOL["score"](starter, found, verbose=False)
    assert (all_right.keys, all_right.right, all_right.missing, all_right.wrong) == (len(found), len(found), 0, 0)
    other = found | {"inputs.wheel_speeds.fl": {"Other.Wheel"}, "inputs.nothing": {"A.B"}}
    score = TOOL["score"](starter, other, verbose=False)
    assert (score.right, score.missing, score.wrong, score.wrong_and_sure) == (len(found) - 1, 1, 1, 1)
    assert score.row("x") == f"| x | {len(found) + 1} | {len(found) - 1} | 1 | 0 | 1 |"
