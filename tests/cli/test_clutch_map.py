"""`dctorque clutch-map`: what a recording says of each clutch, and what is kept of it."""

import json
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return 45 s of hill starts with the truth in it, of a car that does not ask for maps."""
    from dctorque_can.config.load import load_config
    from dctorque_can.offline.simulated_car import DriveName, ProfileName, simulate_car, write_log
    from dctorque_can.resources import shipped_config

    config = load_config(shipped_config("avante_dct7"))
    path = tmp_path_factory.mktemp("map") / "drive.mcap"
    write_log(config, simulate_car(config, DriveName.FRICTION_FADING, ProfileName.PRODUCTION, 1, 45.0), path)
    return path


def test_tables_and_plot(dctorque, log: Path, tmp_path: Path) -> None:
    outcome = dctorque("clutch-map", log, "--truth", "--plot", tmp_path / "maps.png")
    assert outcome.code == 0, outcome.err
    for text in ("Clutch 1", "Clutch 2", "touch point", "hysteresis", "engagements 1 to 5 kJ", "at 75 N·m"):
        assert text in outcome.out
    assert "clutch 1 against the truth: RMS" in outcome.err
    assert (tmp_path / "maps.png").read_bytes().startswith(b"\x89PNG")
    again = dctorque("clutch-map", log, "--plot", tmp_path / "maps.png")
    assert again.code == 1  # it is there already


def test_it_is_right_and_sure_of_no_more_than_it_knows(dctorque, log: Path) -> None:
    """A clutch that loses 30 % of its friction within seconds; the other one has hardly slipped by the end."""
    options = ("--truth", "--set", "clutch_map.period_s=1", "--json")
    found = json.loads(dctorque("clutch-map", log, *options).out)
    assert found["start"] == "new"
    assert found["problems"] == []
    assert found["errors"]["1"]["milliseconds"] > 10_000
    assert found["errors"]["1"]["rms_share"] < 0.03
    assert found["errors"]["1"]["covered"] > 0.9
    assert found["errors"]["2"] is None
    assert found["clutches"][0]["friction_by_heat"] < 0.0


def test_it_goes_on_from_what_is_kept(dctorque, log: Path, tmp_path: Path) -> None:
    first = json.loads(dctorque("clutch-map", log, "--state", tmp_path / "state", "--json").out)
    second = json.loads(dctorque("clutch-map", log, "--state", tmp_path / "state", "--json").out)
    assert (first["start"], second["start"]) == ("new", "kept")
    for before, after in zip(first["clutches"], second["clutches"], strict=True):
        assert after["taken"] == pytest.approx(2 * before["taken"], abs=10)
        assert after["distance_km"] == pytest.approx(2 * before["distance_km"], rel=0.01)
        assert after["energy_j"] == pytest.approx(2 * before["energy_j"], rel=0.01)
    file = Path(second["state"])
    file.write_bytes(file.read_bytes()[:-9])
    third = dctorque("clutch-map", log, "--state", tmp_path / "state", "--json")
    assert json.loads(third.out)["start"] == "new"
    assert f"{file}: it is damaged" in third.err


def test_replay_tells_and_logs_it(dctorque, log: Path, tmp_path: Path) -> None:
    from dctorque_can.daemon.kept_maps import MAPS
    from dctorque_can.logs.mcap.reader import read_table

    out = tmp_path / "out.mcap"
    replayed = dctorque("replay", log, "-o", out, "--set", "clutch_map.enabled=true")
    assert replayed.code == 0, replayed.err
    assert "nodes of its map are valid" in replayed.err
    rows = read_table(out, MAPS)
    learned = json.loads(dctorque("clutch-map", log, "--json").out)["clutches"]
    last = rows[-2:]
    assert [clutch["taken"] for clutch in learned] == last["taken"].tolist()
    plain = dctorque("replay", log, "-o", tmp_path / "plain.mcap", "--json")
    assert json.loads(plain.out)["clutch_map"] is None


def test_what_is_wrong_is_one_line(dctorque, log: Path, tmp_path: Path) -> None:
    for arguments, told in (
        (("--set", "estimator.method=oh2014"), "set estimator.method: kalman"),
        (("--set", "clutch_phase={source: none}"), "clutch_phase.source = none: clutch_map needs the position"),
        (("--set", "clutch_map.least_samples=0"), "clutch_map.least_samples"),
        (("--set", "clutch_map.ids.DctClutchMapp=1"), "did you mean DctClutchMap"),
    ):
        outcome = dctorque("clutch-map", log, *arguments)
        assert outcome.code == 1, arguments
        assert told in outcome.err
        assert "Traceback" not in outcome.err
        assert "clutch_map.enabled" not in outcome.err  # which nobody gave
    assert dctorque("clutch-map", log, "--plot", tmp_path / "maps.txt").code == 2


def test_a_kept_map_helps_the_torques_but_not_itself(dctorque, log: Path, tmp_path: Path) -> None:
    """Used as a command it changes the torques; what is learned stands on estimates that know nothing of it."""
    state = tmp_path / "state"
    dctorque("clutch-map", log, "--state", state)
    learning = ("--state", state, "--set", "clutch_map.enabled=true", "--truth", "--json")
    results = {}
    for used in ("false", "true"):
        out = tmp_path / f"{used}.mcap"
        outcome = dctorque("replay", log, "-o", out, *learning, "--set", f"clutch_map.use_as_command={used}")
        assert outcome.code == 0, outcome.err
        results[used] = json.loads(outcome.out)
    plain, helped = results["false"], results["true"]
    assert plain["clutch_map"]["start"] == helped["clutch_map"]["start"] == "kept"
    before, after = (result["errors"]["clutch1_nm"]["rms"] for result in (plain, helped))
    assert after != before
    assert after < 1.1 * before
    for one, other in zip(plain["clutch_map"]["clutches"], helped["clutch_map"]["clutches"], strict=True):
        assert one["taken"] == other["taken"]
        assert one["friction"] == other["friction"]
    missing = dctorque("replay", log, "-o", tmp_path / "x.mcap", "--state", tmp_path / "none")
    assert missing.code == 1
    assert "no kept maps" in missing.err
