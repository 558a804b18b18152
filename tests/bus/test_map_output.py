"""The maps on the bus, read back by cantools and autosar-e2e."""

import e2e.p01
import numpy as np
import pytest

from dctorque_can.bus.database import DatabaseFile, load_database
from dctorque_can.bus.map_output import MAP, MAP_MESSAGES, MapEncoder
from dctorque_can.clutch_maps.rows import CLUTCH_MAP
from dctorque_can.clutch_maps.settings import NODES
from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.frames import EXTENDED_ID, FrameFlag

from .demo import DBC

DATABASE = load_database([DatabaseFile(DBC / "dctorque_map.dbc")])
OURS = load_database([DatabaseFile(DBC / "dctorque.dbc")])
MS = 1000


def maps():
    rows = np.zeros(2, CLUTCH_MAP)
    rows["clutch"] = 1, 2
    rows["actuation"] = np.linspace(2.0, 8.9, NODES)
    rows["capacity_nm"] = np.linspace(0.0, 230.0, NODES)
    rows["sigma_nm"] = 7.3
    rows["valid"][:, 5:20] = 1
    rows["touch_point"], rows["touch_sigma"], rows["touch_valid"] = (3.04, -41.3), 0.23, (1, 0)
    rows["slope_nm_per_unit"], rows["slope_sigma"] = 51.0, 2.7
    rows["friction"], rows["friction_sigma"] = (0.75, 1.01), 0.046
    return rows


def read(frames):
    found = []
    for i in range(len(frames)):
        message = DATABASE.get_message_by_frame_id(int(frames.can_id[i]))
        payload = frames.data[i, :8].tobytes()
        assert e2e.p01.e2e_p01_check(bytearray(payload), message.frame_id)
        found.append((int(frames.t_us[i]), message.name, message.decode(payload, decode_choices=False)))
    return found


def test_nothing_before_the_first_map():
    assert len(MapEncoder(DATABASE).encode(np.arange(0, 10_000, 1000))) == 0


def test_both_clutches_node_by_node_in_a_second():
    encoder = MapEncoder(DATABASE)
    encoder.renew(maps())
    frames = encoder.encode(np.arange(0, 1000 * MS, 10 * MS))
    assert np.all(frames.flags == FrameFlag.SENT)
    found = read(frames)
    nodes = [(t, values) for t, name, values in found if name == MAP]
    assert [t for t, _ in nodes] == list(range(0, 1000 * MS, 20 * MS))
    told = [(values["MapClutch2"], values["MapNode"]) for _, values in nodes[: 2 * NODES]]
    assert told == [(clutch, node) for clutch in (0, 1) for node in range(NODES)]
    for node, (_, values) in enumerate(nodes[:NODES]):
        assert values["MapActuation"] == pytest.approx(2.0 + 0.3 * node, abs=0.005)
        assert values["MapNodeValid"] == (5 <= node < 20)
        if values["MapNodeValid"]:
            assert values["MapTorque"] == pytest.approx(10.0 * node, abs=0.125)
            assert values["MapSigma"] == pytest.approx(7.3, abs=0.1)
        else:
            assert values["MapTorque"] == 8191 * 0.25
            assert values["MapSigma"] == pytest.approx(1023 * 0.2)


def test_what_is_known_of_each_clutch():
    encoder = MapEncoder(DATABASE)
    encoder.renew(maps())
    values = {
        key: value for _, _, decoded in read(encoder.encode(np.array([0]))) for key, value in decoded.items()
    }
    assert values["TouchPoint1Valid"] == values["Slope1Valid"] == 1
    assert values["TouchPoint2Valid"] == values["Slope2Valid"] == 0
    assert values["TouchPoint1"] == pytest.approx(3.04, abs=0.01)
    assert values["TouchSigma1"] == pytest.approx(0.23, abs=0.005)
    assert values["TouchPoint2"] == pytest.approx(16383 * 0.02 - 100.0)
    assert values["Slope1"] == pytest.approx(51.0, abs=0.05)
    assert values["SlopeSigma1"] == pytest.approx(2.7, abs=0.05)
    assert values["Friction1"] == pytest.approx(75.0, abs=0.1)
    assert values["Friction2"] == pytest.approx(101.0, abs=0.1)
    assert values["FrictionSigma2"] == pytest.approx(4.6, abs=0.1)


def test_one_clutch_alone():
    encoder = MapEncoder(DATABASE)
    encoder.renew(maps()[1:])
    found = read(encoder.encode(np.arange(0, 500 * MS, 20 * MS)))
    assert {values["MapClutch2"] for _, name, values in found if name == MAP} == {1}
    assert {values["Friction1Valid"] for _, name, values in found if name == "DctClutchFriction"} == {0}


def test_batches_and_steps_of_the_clock():
    times = np.concatenate([np.arange(0, 300 * MS, 7 * MS), np.arange(100 * MS, 2500 * MS, 7 * MS)])
    whole, cut = MapEncoder(DATABASE), MapEncoder(DATABASE)
    for encoder in (whole, cut):
        encoder.renew(maps())
    expected = whole.encode(times)
    parts = [cut.encode(times[i : i + 3]) for i in range(0, len(times), 3)]
    assert expected.data.tobytes() == b"".join(part.data.tobytes() for part in parts)
    gaps = np.diff([t for t, name, _ in read(expected) if name == MAP])
    assert np.abs(gaps[gaps > 0]).max() <= 21 * MS
    assert gaps.min() < 0


def test_other_identifiers():
    assert MapEncoder(DATABASE, {MAP: 0x18FF0000}).can_ids[MAP] == 0x18FF0000 | EXTENDED_ID
    with pytest.raises(DctorqueError, match="id of DctClutchMapp: no such message; did you mean DctClutchMap"):
        MapEncoder(DATABASE, {"DctClutchMapp": 1})


def test_identifiers_and_names_are_those_of_no_other_message():
    assert [message.name for message in DATABASE.messages] == list(MAP_MESSAGES)
    assert not {m.frame_id for m in DATABASE.messages} & {m.frame_id for m in OURS.messages}
