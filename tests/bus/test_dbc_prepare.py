"""DBCs that cantools refuses: what is not needed never costs the file, what is needed is told with its line."""

import time
from pathlib import Path

import cantools
import pytest

from dctorque_can.bus.database import DatabaseError, DatabaseFile, joined_databases, load_with_remarks
from dctorque_can.bus.dbc_prepare import Needed, prepare
from dctorque_can.bus.dbc_text import decoded, statements

GOOD = """VERSION ""

NS_ :
\tCM_
\tBA_

BS_:

BU_: ECU

BO_ 256 Engine: 8 ECU
 SG_ Speed : 0|16@1+ (0.25,0) [0|0] "rpm" ECU
 SG_ Torque : 16|12@1+ (1,-1000) [0|0] "Nm" ECU

BO_ 257 Lamp: 2 ECU
 SG_ Colour : 0|4@1+ (1,0) [0|0] "" ECU
 SG_ Bright : 4|4@1+ (1,0) [0|0] "" ECU

CM_ SG_ 256 Speed "of the crankshaft";
VAL_ 257 Colour 0 "red" 1 "green" ;
"""
ENGINE = Needed(frozenset({"Engine"}), frozenset({"Engine.Speed"}))
WHOLE = {"Engine": ["Speed", "Torque"], "Lamp": ["Bright", "Colour"]}


def load(text, needed=ENGINE, strict=True):
    content = text if isinstance(text, bytes) else text.encode()
    return load_with_remarks([DatabaseFile(Path("x.dbc"), strict, content)], needed)


def names(loaded):
    return {m.name: sorted(s.name for s in m.signals) for m in loaded.database.messages}


def remarks(loaded):
    return [str(remark) for remark in loaded.remarks]


def failure(text, needed=ENGINE, strict=True):
    with pytest.raises(DatabaseError) as caught:
        load(text, needed, strict)
    return str(caught.value).splitlines()


def line_of(text, fragment):
    return next(k for k, line in enumerate(text.splitlines(), 1) if fragment in line)


def test_what_is_sound_is_read_by_cantools_alone():
    assert load(GOOD).remarks == ()


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ('CM_ SG_ 257 "no signal is named";', "the comment of a signal does not name the signal"),
        ('CM_ 257 "of nothing";', "the comment does not say what it is about"),
        ('CM_ "without an end"', "CM_ has no ; at its end"),
        ('CM_ SG_ 257 Colour "not closed;', "CM_ has a quote that is not closed"),
        ('CM_ SG_ 257 Colour 5" wide";', "CM_ SG_ 257 Colour"),
        ('VAL_ 999 Colour 0 "red" ;', "VAL_ is about the message 999, which is not there"),
        ('VAL_ 257 Shade 0 "red" ;', "VAL_ is about the signal 'Shade' of the message 257, which is not there"),
        ('VAL_ 257 Bright 0.5 "half" ;', "invalid literal"),
        ('VAL_ 257 Bright 0 "off"', "VAL_ has no ; at its end"),
        ("SIG_VALTYPE_ 257 Shade : 1;", "SIG_VALTYPE_ is about the signal 'Shade'"),
        ('BA_ "GenMsgCycleTime" BO_ 257 100;', "'GenMsgCycleTime' is used but not defined"),
        ('BA_DEF_ BO_ "Half" INT 0;', "list index out of range"),
        ("VAL_TABLE_ Colours 0 red ;", "Invalid syntax"),
        ("SIG_GROUP_ 257 Both : Colour;", "Invalid syntax"),
        ("FOO_ 257 Colour;", "'FOO_ 257 Colour;' begins with no keyword of a DBC"),
        ("BU_SG_REL_ ECU 257;", "Invalid syntax"),
    ],
)
def test_a_line_that_is_not_needed_never_costs_the_file(line, reason):
    for before in ("CM_ SG_ 256", "BO_ 257", "BO_ 256"):
        text = GOOD.replace(before, f"{line}\n{before}", 1)
        loaded = load(text)
        assert names(loaded) == WHOLE
        (remark,) = remarks(loaded)
        assert remark.startswith(f"x.dbc:{line_of(text, line)}: ")
        assert reason in remark
        assert remark.endswith("it is left out")
        by_name = loaded.database.get_message_by_name("Engine")
        assert by_name.get_signal_by_name("Speed").comment == "of the crankshaft"


def test_a_comment_of_several_lines_may_hold_what_looks_like_keywords():
    text = GOOD.replace('"of the crankshaft"', '"of the\nBO_ crankshaft\n  SG_ and more"') + 'VAL_ 1 X 0 "a" ;\n'
    loaded = load(text)
    speed = loaded.database.get_message_by_name("Engine").get_signal_by_name("Speed")
    assert speed.comment == "of the\nBO_ crankshaft\n  SG_ and more"
    assert len(loaded.remarks) == 1
    assert loaded.remarks[0].line == line_of(text, "VAL_ 1 X")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("BO_ 257 Lamp: 2 ECU", "BO_ 257 Lamp: two ECU"),
        ("BO_ 257 Lamp: 2 ECU", "BO_ Lamp: 2 ECU"),
        ("BO_ 257 Lamp: 2 ECU", "BO_ 1610612736 Lamp: 2 ECU"),
        (" SG_ Bright : 4|4@1+", " SG_ Bright : 3|4@1+"),
        (" SG_ Bright : 4|4@1+", " SG_ Bright : 13|4@1+"),
    ],
)
def test_a_message_that_nobody_maps_is_left_out(before, after):
    text = GOOD.replace(before, after)
    loaded = load(text)
    assert list(names(loaded)) == ["Engine"]
    assert loaded.remarks[0].line in (line_of(text, after), line_of(text, "SG_ Colour"))
    assert "the message" in loaded.remarks[0].reason
    assert ("strict: false" in loaded.remarks[0].reason) == ("SG_" in after)
    assert all("VAL_" in remark for remark in remarks(loaded)[1:])


@pytest.mark.parametrize(
    "after", [" SG_ Bright : 4@1+", " SG_ Bright : 4|0@1+", " SG_ Bright 4|4@1+", " SG_ Bright : x|4@1+"]
)
def test_a_signal_that_nobody_maps_is_left_out(after):
    text = GOOD.replace(" SG_ Bright : 4|4@1+", after)
    loaded = load(text)
    assert names(loaded) == {"Engine": ["Speed", "Torque"], "Lamp": ["Colour"]}
    assert [remark.line for remark in loaded.remarks] == [line_of(text, after)]
    of_engine = text.replace(" SG_ Torque : 16|12@1+", after.replace("Bright", "Torque"))
    assert names(load(of_engine))["Engine"] == ["Speed"]


@pytest.mark.parametrize(
    ("before", "after", "place", "hint"),
    [
        ("Engine: 8 ECU", "Engine: eight ECU", "eight", "a message is written BO_ identifier Name: bytes sender"),
        ("Speed : 0|16", "Speed : 0:16", "0:16", "a signal is written SG_ Name : start|length@1+"),
        ("Torque : 16|12", "Torque : 15|12", "Torque : 15", "it loads with `strict: false`"),
        ("Speed : 0|16", "Speed : 0|0", "0|0", "The signal Speed length 0"),
    ],
)
def test_what_is_needed_and_broken_is_an_error_with_line_and_hint(before, after, place, hint):
    text = GOOD.replace(before, after)
    (error,) = failure(text)
    assert error.startswith(f"x.dbc:{line_of(text, place)}: ")
    assert hint in error


def test_all_faults_are_told_at_once_and_the_hint_stays():
    text = GOOD.replace("Speed : 0|16", "Speed : 0|0").replace("Torque : 16|12", "Torque : 60|12")
    text = text.replace("Colour : 0|4", "Colour : 0;4") + 'VAL_ 1 X 0 "a" ;\n'
    assert len(failure(text, None)) == 3
    overlap = GOOD.replace("Torque : 16|12", "Torque : 15|12") + 'CM_ 1 "x";\n'
    (error,) = failure(overlap)
    assert error == (
        f"x.dbc:{line_of(overlap, 'Torque')}: The signals Torque and Speed are overlapping in message Engine; "
        "it loads with `strict: false`"
    )
    assert names(load(overlap, strict=False)) == WHOLE


def test_how_a_needed_signal_is_read_must_not_be_lost():
    text = GOOD + "SIG_VALTYPE_ 256 Speed 1;\n"
    (error,) = failure(text)
    assert error.startswith(f"x.dbc:{line_of(text, 'SIG_VALTYPE_')}: ")
    assert "it says how Engine.Speed is read" in error
    other = GOOD + "SIG_VALTYPE_ 256 Torque 1;\n"
    assert [remark.line for remark in load(other).remarks] == [line_of(other, "SIG_VALTYPE_")]


def test_an_identifier_without_bit_31():
    text = GOOD.replace("257", "274989056")
    loaded = load(text)
    lamp = loaded.database.get_message_by_name("Lamp")
    assert (lamp.frame_id, lamp.is_extended_frame) == (0x10640000, True)
    assert dict(lamp.get_signal_by_name("Colour").choices) == {0: "red", 1: "green"}
    assert [remark.line for remark in loaded.remarks] == [line_of(text, "BO_ 274989056")]
    assert "read as one of 29 bits" in loaded.remarks[0].reason


def test_names_that_cantools_cannot_read():
    text = GOOD.replace("Lamp", "2017_5").replace("Colour", "0_Colour").replace("Bright", "Hell-igkeit")
    text += "SIG_GROUP_ 257 Both 1 : 0_Colour Hell-igkeit;\nBU_SG_REL_ x;\n"
    loaded = load(text)
    assert names(loaded)["2017_5"] == ["0_Colour", "Hell-igkeit"]
    lamp = loaded.database.get_message_by_name("2017_5")
    assert lamp.decode(b"\x21\x00") == {"0_Colour": "green", "Hell-igkeit": 2}
    assert "2017_5" in {
        message.name for message in load(text, Needed(frozenset({"2017_5"}), frozenset())).database.messages
    }


def test_numbers_without_a_leading_digit_and_values_without_quotes():
    text = GOOD.replace("(0.25,0)", "(.25,-.5)").replace("(1,-1000)", "(1.5e1,-1000)")
    text += 'BA_DEF_ BO_ "Sent" ENUM "No","Yes";\nBA_DEF_DEF_ "Sent" No;\n'
    text += 'BA_DEF_ "Bus" STRING ;\nBA_DEF_DEF_ "Bus" CAN;\n'
    loaded = load(text)
    speed = loaded.database.get_message_by_name("Engine").get_signal_by_name("Speed")
    assert (speed.scale, speed.offset) == (0.25, -0.5)
    defaults = loaded.database.dbc.attribute_definitions
    assert [defaults[name].default_value for name in ("Sent", "Bus")] == ["No", "CAN"]
    assert [(remark.line, remark.reason[:9]) for remark in loaded.remarks] == [
        (line_of(text, "(.25"), "a number "),
        (line_of(text, 'Sent" No'), "a default"),
    ]
    assert loaded.remarks[1].reason.endswith(f"(also line {line_of(text, ' CAN;')})")


def test_senders_and_receivers_that_are_missing_or_odd():
    text = GOOD.replace("Lamp: 2 ECU", "Lamp: 2").replace('[0|0] "" ECU', '[0|0] "" 2ND_ECU,', 1)
    assert names(load(text.replace("BU_: ECU", "BU_: ECU 2ND_ECU"))) == WHOLE


def test_contradicting_messages_count_only_where_they_are_needed():
    other = GOOD.replace("Colour : 0|4", "Colour : 0|3")
    both = [(Path(name), load(text).database) for name, text in (("a.dbc", GOOD), ("b.dbc", other))]
    joined = joined_databases(both, ENGINE)
    assert joined.database.get_message_by_name("Lamp").get_signal_by_name("Colour").length == 4
    assert "b.dbc: message Lamp (id 0x101) contradicts Lamp" in str(joined.remarks[0])
    with pytest.raises(DatabaseError, match="contradicts Lamp"):
        joined_databases(both, Needed(frozenset({"Lamp"}), frozenset()))


UNITS = GOOD.replace('"rpm"', '"°"').replace('"Nm"', '"m/s²"').replace("Colour", "Farbe").replace("red", "grün")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("more", ["", 'CM_ 1 "x";\n'])
def test_encodings(encoding, end, more):
    loaded = load((UNITS + more).replace("\n", end).encode(encoding))
    engine, lamp = loaded.database.messages
    assert [signal.unit for signal in engine.signals] == ["°", "m/s²"]
    assert str(lamp.get_signal_by_name("Farbe").choices[0]) == "grün"
    assert [remark.line for remark in loaded.remarks] == ([line_of(UNITS + more, "CM_ 1")] if more else [])


def test_a_file_of_lines_in_two_encodings():
    lines = UNITS.splitlines(keepends=True)
    content = b"".join(line.encode("cp1252" if "VAL_" in line else "utf-8") for line in lines)
    assert decoded(content) == UNITS


def test_the_prepared_text_keeps_its_lines():
    text = GOOD.replace("CM_ SG_ 256", 'FOO\n\nCM_ 7 "x";\nCM_ SG_ 256').replace("257", "274989056")
    prepared = prepare(text, strict=True, needed=ENGINE)
    before, after = text.split("\n"), prepared.text.split("\n")
    assert all(now in ("", then) or "2422472704" in now for then, now in zip(before, after, strict=False))
    assert "".join(each.text for each in statements(text)) == text
    assert len(cantools.database.load_string(prepared.text, "dbc").messages) == 2


@pytest.mark.parametrize("line", ["BO_ 257 Other: 8 ECU", "BO_ 300 Lamp: 8 ECU"])
def test_messages_that_share_name_or_identifier_are_told(line, capfd):
    text = GOOD + f'{line}\n SG_ X : 0|8@1+ (1,0) [0|0] "" ECU\n'
    (remark,) = load(text).remarks
    assert remark.line == line_of(text, line)
    assert "share a name or an identifier" in remark.reason
    assert load(text.replace(line, line + "X")).remarks[-1].line != 0
    assert load(GOOD + "\n".join(GOOD.splitlines()[14:17]) + "\n").remarks == ()
    assert capfd.readouterr() == ("", "")


def test_one_fault_among_thousands_of_messages():
    many = "".join(
        f'BO_ {k} M{k}: 8 ECU\n SG_ A : 0|8@1+ (1,0) [0|0] "" ECU\n' for k in range(0x20000000 - 5000, 0x20000000)
    )
    text = GOOD + many.replace("M536870000: 8", "M536870000: x")
    loaded = load(text)
    assert len(loaded.database.messages) == 2 + 4999
    assert [remark.line for remark in loaded.remarks if "left out" in remark.reason] == [line_of(text, ": x ECU")]


def test_more_faults_than_can_be_told_one_by_one():
    text = GOOD + "".join(f'CM_ SG_ 256 Speed "a" {k};\n' for k in range(3000))
    assert failure(text)[0].endswith("has more faults than can be told one by one; is this a DBC file?")


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("Engine: 8", "Engine: 800000", "x.dbc:11: 800000 bytes are more than 4095, the most in column 17"),
        (": 0|16@", " : 2147483648|16@", "x.dbc:12: bit 2147483648 is beyond the largest message in column 15"),
        ("0|16@", "0|" + "9" * 5000 + "@", "x.dbc:12: 9"),
        (
            "VAL_ 257",
            "SG_MUL_VAL_ 256 Speed Torque 0-1, 7-99999999;\nVAL_ 257",
            "x.dbc:20: 99999995 multiplexer values are more than 4096 in column 30",
        ),
    ],
)
def test_sizes_that_would_cost_memory_and_time_are_told_with_their_line(before, after, said):
    """Found by tools/fuzz: cantools takes gigabytes and minutes for one such number, for it believes them all."""
    text = GOOD.replace(before, after, 1)
    began = time.process_time()
    assert failure(text, needed=None)[0].startswith(said)
    lamp = Needed(frozenset({"Lamp"}), frozenset({"Lamp.Colour"}))
    loaded = load(text, lamp)
    assert names(loaded)["Lamp"] == WHOLE["Lamp"]
    assert remarks(loaded)[0].startswith(said)
    assert time.process_time() - began < 5.0


def test_a_message_of_iso_tp_is_read():
    text = GOOD.replace("Engine: 8", "Engine: 4095").replace("16|12@", "32748|12@")
    assert names(load(text)) == WHOLE


def test_doubled_messages_with_names_that_were_mended_are_not_told_twice(capfd, caplog):
    """Found by tools/fuzz: cantools' own warning came too, without file and line."""
    text = GOOD.replace("Lamp", "2Lamp") + 'BO_ 258 Engine: 8 ECU\n SG_ Speed : 0|8@1+ (1,0) [0|0] "" ECU\n'
    assert any("Engine" in each for each in remarks(load(text)))
    assert caplog.text == ""
    assert capfd.readouterr().err == ""
