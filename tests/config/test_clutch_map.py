"""The `clutch_map:` and `state:` sections: what they ask for, and what is told when it cannot be."""

import pytest

from dctorque_can.pipeline.samples import Quantity

ON = {"clutch_map.enabled": True}


def test_off_unless_asked_for(load) -> None:
    config = load({})
    assert config.clutch_map is None
    assert config.state.directory is None


def test_what_closes_the_clutches(load) -> None:
    rules = load(ON | {"clutch_phase.clutch1.kissing_point_error": 0.4}).clutch_map
    one, two = rules.clutches
    assert (one.quantity, two.quantity) == (Quantity.CLUTCH1_POSITION, Quantity.CLUTCH2_POSITION)
    assert (one.touch_point, one.touch_error, one.closing_sign) == (3.0, 0.4, 1.0)
    assert two.touch_error == pytest.approx(0.6)  # a fifth of the kissing point
    assert rules.capacity_nm == (pytest.approx(468.0), pytest.approx(468.0))  # 4 · 0.30 · 0.13 m · 3000 N
    assert rules.ratios[2] == pytest.approx(3.78 * 3.7)
    assert load(ON | {"clutch_phase.clutch1.closes": "decreasing"}).clutch_map.clutches[0].closing_sign == -1.0


def test_a_command_where_no_position_is_told(load) -> None:
    flags = {"signal": "Gearbox.GearShaft1", "values": {0: "open", 1: "closed"}}
    command = {"signal": "EngineData.EngineTorque", "range": [-10, 500]}
    phase = {"source": "flag", "clutch1": flags, "clutch2": flags}
    config = load(ON | {"clutch_phase": phase, "inputs.clutch2_command": command})
    one, two = config.clutch_map.clutches
    assert one is None
    assert (two.quantity, two.touch_point) == (Quantity.CLUTCH2_COMMAND, 0.0)
    assert two.touch_error == pytest.approx(0.03 * 468.0)


@pytest.mark.parametrize(
    ("changes", "key", "reason"),
    [
        ({"estimator.method": "oh2014"}, "estimator.method", "set estimator.method: kalman"),
        ({"clutch_phase": {"source": "none"}}, "clutch_phase.source", "needs the position, pressure or command"),
        (
            {
                "clutch_map.use_as_command": True,
                "inputs.clutch1_command": {"signal": "EngineData.EngineTorque", "range": [-10, 500]},
            },
            "clutch_map.use_as_command",
            "among the inputs already",
        ),
        ({"clutch_map.ids": {"DctTouch": 5}}, "clutch_map.ids.DctTouch", "did you mean DctClutchTouch"),
        ({"clutch_map.least_samples": 0}, "clutch_map.least_samples", "greater than or equal to 1"),
        ({"clutch_map.nodes": 5}, "clutch_map.nodes", "unknown key"),
        ({"state.save_s": 0}, "state.save_s", "greater than or equal to 1"),
    ],
)
def test_what_cannot_be(errors, changes, key: str, reason: str) -> None:
    (problem,) = errors(ON | changes)
    assert problem.key == key
    assert reason in problem.reason
