"""Loading of DBCs: every failure says file, line, reason and hint."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dctorque_can.bus.database import DatabaseError, DatabaseFile, load_database

from .demo import DBC

DEMO = (DBC / "demo_car.dbc").read_text("cp1252")
TORQUE = " SG_ EngineTorque : 32|12@1+"


def load(text, strict=True, name="x.dbc"):
    return load_database([DatabaseFile(Path(name), strict, text.encode("cp1252"))])


def failure(text, strict=True):
    with pytest.raises(DatabaseError) as caught:
        load(text, strict)
    return str(caught.value)


def line_of(text, fragment):
    return next(k for k, line in enumerate(text.splitlines(), 1) if fragment in line)


@pytest.mark.parametrize("name", ["demo_car.dbc", "demo_car_signed.dbc", "dctorque.dbc"])
def test_the_shipped_databases_load_strictly_and_state_cycle_times(name):
    database = load_database([DatabaseFile(DBC / name)])
    assert all(message.cycle_time in (10, 20, 100) for message in database.messages)
    assert all(message.comment for message in database.messages)
    for message in database.messages:
        for signal in message.signals:
            if signal.unit:  # every measured value has a highest raw value that means not available
                assert signal.choices[2**signal.length - 1] == "not available"
                top = (2**signal.length - 2) * float(signal.scale) + float(signal.offset)
                assert float(signal.maximum) <= top


@pytest.mark.parametrize(
    ("place", "reason"),
    [
        (" SG_ EngineTorque : 30|12@1+", "The signals EngineTorque and EngineSpeed are overlapping"),
        (" SG_ EngineTorque : 60|12@1+", "The signal EngineTorque does not fit in message EngineData"),
    ],
)
def test_a_database_that_loads_only_laxly(place, reason):
    text = DEMO.replace(TORQUE, place)
    message = failure(text)
    assert message.startswith(f"x.dbc:{line_of(text, place)}: {reason}")
    assert message.endswith("; it loads with `strict: false`")
    assert len(load(text, strict=False).messages) == 6


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        ("InputShafts: 8", "InputShafts: eight", "Invalid syntax"),
        ("BO_ 272 InputShafts", "BO_ 1610612736 InputShafts", "Standard frame id 0x60000000 is more than 11 bits"),
        (TORQUE, " SG_ EngineTorque : 32|0@1+", "The signal EngineTorque length 0"),
    ],
)
@pytest.mark.parametrize("strict", [True, False])
def test_a_database_that_does_not_load(before, after, reason, strict):
    text = DEMO.replace(before, after)
    message = failure(text, strict)
    assert message.startswith(f"x.dbc:{line_of(text, after)}: {reason}")
    assert "strict" not in message


@pytest.mark.parametrize("text", ["", "name: car\ninputs: {}\n", "\x00\x01\x02MDF"])
def test_a_file_that_is_no_database(text):
    assert failure(text).startswith("x.dbc:")
    assert failure(text).endswith("is this a DBC file?")


def test_a_database_without_messages():
    assert failure('VERSION ""\nNS_ :\nBS_:\nBU_:\n') == "x.dbc: holds no message"


def test_missing_files_are_all_named():
    with pytest.raises(DatabaseError) as caught:
        load_database([DatabaseFile(Path("/nowhere/a.dbc")), DatabaseFile(Path("/nowhere/b.dbc"))])
    assert str(caught.value).splitlines() == [
        "/nowhere/a.dbc: cannot be read: No such file or directory",
        "/nowhere/b.dbc: cannot be read: No such file or directory",
    ]


def test_databases_are_joined():
    both = load_database([DatabaseFile(DBC / "demo_car.dbc"), DatabaseFile(DBC / "dctorque.dbc")])
    assert {m.name for m in both.messages} >= {"EngineData", "DctStatus"}
    assert both.get_message_by_name("DctStatus").cycle_time == 100


def test_equal_messages_may_repeat():
    twice = load_database([DatabaseFile(DBC / "demo_car.dbc")] * 2)
    assert len(twice.messages) == 6


@pytest.mark.parametrize(
    ("before", "after"), [("EngineData", "MotorData"), ("BO_ 256 ", "BO_ 257 "), ("(0.25,0)", "(0.5,0)")]
)
def test_contradicting_databases(before, after):
    other = DEMO.replace(before, after)
    if after == "BO_ 257 ":
        other = other.replace(" 256 ", " 257 ")
    files = [
        DatabaseFile(Path("one.dbc"), content=DEMO.encode()),
        DatabaseFile(Path("two.dbc"), content=other.encode()),
    ]
    with pytest.raises(
        DatabaseError, match=r"two\.dbc: message \w+ \(id 0x10[01]\) contradicts EngineData .* of one\.dbc"
    ):
        load_database(files)


@settings(max_examples=40)
@given(st.integers(0, len(DEMO) - 1), st.integers(0, 40), st.binary(max_size=3))
def test_a_damaged_database_loads_or_is_refused_with_a_line_for_each_fault(start, removed, inserted):
    content = DEMO.encode("cp1252")
    damaged = content[:start] + inserted + content[start + removed :]
    reason = ""
    try:
        load_database([DatabaseFile(Path("x.dbc"), content=damaged)])
    except DatabaseError as error:
        reason = str(error)
    assert all(line.startswith("x.dbc") for line in reason.splitlines())
