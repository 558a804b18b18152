"""STUDY.yaml: every mistake at once, with its line."""

from pathlib import Path

import pytest

from dctorque_can.config.problems import ConfigError
from dctorque_can.errors import DctorqueError
from dctorque_can.resources import find_study, shipped_config, shipped_studies
from dctorque_can.study.catalogue import is_catalogue
from dctorque_can.study.code import EVERYTHING, SIMULATION, code
from dctorque_can.study.factors import FACTORS
from dctorque_can.study.plan import FactorSection, load_study

DOC = (Path(__file__).resolve().parents[2] / "docs" / "study.md").read_text()


@pytest.mark.parametrize("path", shipped_studies(), ids=lambda path: path.stem)
def test_shipped_studies_vary_everything(path: Path) -> None:
    if path.stem == "manoeuvres":
        assert is_catalogue(path)
        return
    assert not is_catalogue(path)
    study = load_study(path)
    twice = {"sensor_noise_factor"}  # it would repeat the three single ones
    other_bus = {"engine_torque_lag_ms"}  # which tells what is demanded of the engine
    manoeuvres = {"tyre_friction_factor", "clutch_drag_nms_per_rad", "spin_loss_nm", "spin_loss_nms_per_rad"}
    if path.stem == "demanded_torque":
        assert set(study.vary) == other_bus
    elif path.stem == "coverage":
        assert study.plan.runs >= 50
        assert set(study.vary) == set(FACTORS) - twice - other_bus - manoeuvres - {"payload_kg"}
    else:
        assert study.plan.runs == 200
        assert set(study.vary) == set(FACTORS) - twice - other_bus - manoeuvres - {"mass_factor"}
        assert study.config.path.name == path.name


def test_keys_can_be_changed(write_study) -> None:
    path = write_study()
    plan = load_study(path, changes={"drive": "mixed", "duration_s": None, "runs": 9, "seed": 3}).plan
    assert (plan.drive, plan.duration_s, plan.runs, plan.seed, plan.profile) == ("mixed", None, 9, 3, "production")
    assert load_study(path, changes={"vehicle": "avante_dct7"}).config.name == "Avante DCT7"
    with pytest.raises(ConfigError) as caught:
        load_study(path, changes={"vehicle": "avante", "duration_s": 1.0})
    told = {problem.file: problem.reason for problem in caught.value.problems}
    assert "did you mean avante_dct7?" in told["--vehicle"]
    assert "3" in told["--duration"]


def test_names_are_found_as_those_of_vehicles_are(write_study, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_study("paper_car") in shipped_studies()
    assert find_study("none") == Path("none")
    (tmp_path / "sub").mkdir()
    path = write_study("sub/near.yaml", vehicle="car.yaml")
    text = shipped_config("paper_car").read_text()
    dbc = shipped_config("paper_car").parent.parent / "dbc"
    (tmp_path / "sub" / "car.yaml").write_text(text.replace("../dbc", str(dbc)).replace("paper car", "near car"))
    assert load_study(path).config.name == "near car"  # relative to the study, not to the working directory


def test_every_mistake_is_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(
        "vehicle: papercar\n"
        "drive: rally\n"
        "runs: many\n"
        "sed: 3\n"
        "vary:\n"
        "  engine_inertia_facto: {uniform: {low: 0.8, high: 1.2}}\n"
        "  wind: {normal: {mean: 0, std: 1}}\n"
        "  tyre_radius_factor: {uniform: {low: 1.1, high: 1.0}}\n"
        "  payload_kg: {normal: {mean: 100, std: 50}}\n"
        "  bus_delay_ms: {unifrom: {low: 0, high: 1}}\n"
        "  grade_offset_rad: {}\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_study(path)
    told = {(problem.line, problem.key): problem.reason for problem in caught.value.problems}
    for line, key, reason in (
        (1, "vehicle", "did you mean paper_car?"),
        (2, "drive", "must be one of: paper or mixed"),
        (3, "runs", "must be a whole number"),
        (4, "sed", "did you mean seed?"),
        (6, "vary.engine_inertia_facto", "did you mean engine_inertia_factor"),
        (7, "vary.wind", "there is: bus_delay_ms, clutch_drag_nms_per_rad, clutch_friction_factor"),
        (8, "vary.tyre_radius_factor.uniform.high", "must be more than low"),
        (9, "vary.payload_kg", "draws from -50 to 250, and physics allows 0 to 40000"),
        (10, "vary.bus_delay_ms.unifrom", "did you mean uniform?"),
        (11, "vary.grade_offset_rad", "must have one distribution"),
    ):
        assert reason in told[line, key]
    assert all(str(path) == problem.file for problem in caught.value.problems)


def test_mistakes_of_the_vehicle_are_told_too(write_study, tmp_path: Path) -> None:
    (tmp_path / "car.yaml").write_text("name: x\n")
    with pytest.raises(ConfigError) as caught:
        load_study(write_study(vehicle="car.yaml", drive="mixed", duration_s=100))
    text = str(caught.value)
    assert "small.yaml:3: duration_s = 100: a mixed drive needs at least 180 s" in text
    assert "car.yaml:1: vehicle: missing" in text
    with pytest.raises(DctorqueError, match="cannot be read: No such file"):
        load_study(tmp_path / "nowhere.yaml")


def test_the_identity_is_what_the_runs_depend_on(write_study) -> None:
    def identity(**changes):
        return load_study(write_study(**changes)).identity()

    assert identity() == identity(runs=50)  # run k is the same however many there are
    a = {"payload_kg": {"uniform": {"low": 0, "high": 10}}, "bus_delay_ms": {"uniform": {"low": 0, "high": 1}}}
    assert identity(vary=a) == identity(vary=dict(reversed(a.items())))
    different = [
        identity(),
        identity(seed=8),
        identity(duration_s=4),
        identity(vary=a),
        identity(vehicle="avante_dct7"),
    ]
    assert len({str(one) for one in different}) == len(different)
    assert identity()["code"] == code(EVERYTHING) != code(SIMULATION)


def test_every_key_and_factor_is_documented() -> None:
    for name, factor in FACTORS.items():
        assert (
            f"| `{name}` | {factor.nominal:g} | {factor.lowest:g} … {factor.highest:g} | {factor.meaning} |" in DOC
        )
        assert factor.lowest <= factor.nominal <= factor.highest
    for key in FactorSection.model_fields:
        assert f"`{key}`" in DOC


def test_the_code_of_a_room_or_file_that_is_not_there_is_no_code() -> None:
    nothing = code(())
    assert all(code((room,)) != nothing for room in EVERYTHING)
