"""Names of DBCs are cut into words in several languages."""

import pytest

from dctorque_can.starter.words import Word, number_of, tokens, unknown_words, wheel_of, words


@pytest.mark.parametrize(
    ("name", "cut"),
    [
        ("EngSpd", ("eng", "spd")),
        ("WHL_SPD_FL", ("whl", "spd", "fl")),
        ("nMot", ("n", "mot")),
        ("FLWheelSpd", ("fl", "wheel", "spd")),
        ("Drehzahl_01", ("drehzahl", "01")),
        ("Rückwärtsgang", ("rueckwaertsgang",)),
    ],
)
def test_names_are_cut(name: str, cut: tuple[str, ...]) -> None:
    assert tokens(name) == cut


@pytest.mark.parametrize(
    ("name", "told", "not_told"),
    [
        ("EngSpd", {Word.ENGINE, Word.SPEED}, {Word.TARGET, Word.FILTERED}),
        ("Motordrehzahl", {Word.ENGINE, Word.SPEED}, {Word.WHEEL}),
        ("EngSpdTgt", {Word.ENGINE, Word.TARGET}, set()),
        ("Leerlaufsolldrehzahl", {Word.IDLE, Word.TARGET, Word.SPEED}, set()),
        ("Radgeschw_VL", {Word.WHEEL, Word.SPEED}, {Word.ENGINE}),
        ("TQ_FR", {Word.TORQUE, Word.FRICTION}, set()),
        ("WhlSpdFR", {Word.WHEEL, Word.SPEED}, {Word.FRICTION}),
        ("Eingangsdrehzahl", {Word.INPUT, Word.SPEED}, {Word.GEAR}),
        ("Istgang", {Word.GEAR, Word.ACTUAL}, {Word.TARGET}),
        ("Zielgang", {Word.GEAR, Word.TARGET}, set()),
    ],
)
def test_words_are_understood(name: str, told: set[Word], not_told: set[Word]) -> None:
    assert told <= words(name)
    assert not not_told & words(name)


@pytest.mark.parametrize(
    ("name", "wheel"),
    [
        *(("WhlSpdFL", "fl"), ("WHL_SPD_RR", "rr"), ("WhlRr_W", "rr"), ("vRadHL", "rl"), ("WS_RF", "fr")),
        *(("FrontRightWheelSpeed", "fr"), ("REAR_LEFT_WHEEL_SPEED", "rl"), ("WhlBckL", "rl"), ("vWhlRrL", "rl")),
        *(("Radgeschwvr", "fr"), ("WhlSpdAvg", ""), ("EngSpd", ""), ("Motordrehzahl", "")),
    ],
)
def test_wheels_are_told_apart(name: str, wheel: str) -> None:
    assert wheel_of(name) == wheel


@pytest.mark.parametrize(
    ("name", "number"),
    [
        *(("InpShaft1Spd", 1), ("N_IN2", 2), ("ISS_ODD", 1), ("ISS_EVEN", 2), ("Kup1", 1), ("C2", 2)),
        *(("Kupplung_2_Position", 2), ("InpSpd", 0), ("Torque12", 0), ("Wellendrehzahl_ungerade", 1)),
    ],
)
def test_shafts_are_told_apart(name: str, number: int) -> None:
    assert number_of(name) == number


def test_what_is_not_understood_is_told() -> None:
    assert unknown_words("BrakeZorblxActive") == ("zorblx",)
    assert unknown_words("EngSpd_Abc") == ()
