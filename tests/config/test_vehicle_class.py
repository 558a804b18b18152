"""A class of cars gives what a vehicle file leaves out, and any number may say how sure it is."""

from pathlib import Path

import pytest
import yaml

from dctorque_can.config.load import ConfigError, load_config
from dctorque_can.resources import shipped_class, shipped_classes, shipped_config, shipped_dbc

CLASSES = [path.stem for path in shipped_classes()]


def written(folder: Path, vehicle: dict[str, object]) -> Path:
    """Return the shipped paper car with another section `vehicle`."""
    data = yaml.safe_load(shipped_config("paper_car").read_text())
    data["databases"] = [str(shipped_dbc("demo_car"))]
    data["vehicle"] = vehicle
    path = folder / "car.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def brochure(name: str) -> dict[str, object]:
    """Return what the owner of a car of this class knows."""
    own = yaml.safe_load(shipped_class(name).read_text())["vehicle"]
    gears = {n: {key: gear[key] for key in ("shaft", "ratio", "final_drive")} for n, gear in own["gears"].items()}
    for gear in gears.values():
        gear["ratio"] *= 1.01
    used = {n: gear for n, gear in gears.items() if n in (1, 2, 3, 4, 5)}  # the demo car's bus has no more
    return {"class": name, "gears": used, "driven_axle": own["driven_axle"]}


@pytest.mark.parametrize("name", CLASSES)
def test_ratios_and_a_class_are_a_car(name: str, tmp_path: Path) -> None:
    config = load_config(written(tmp_path, brochure(name)))
    assert not [problem for problem in config.warnings if problem.key.startswith("vehicle")]
    own = yaml.safe_load(shipped_class(name).read_text())["vehicle"]
    vehicle = config.settings.vehicle
    assert vehicle.chassis.mass_kg == own["chassis"]["mass_kg"]
    assert vehicle.gear(3).ratio == own["gears"][3]["ratio"] * 1.01
    assert vehicle.gear(3).inertia_kgm2 == own["gears"][3]["inertia_kgm2"]
    assert config.of_class["vehicle.chassis.mass_kg"] == own["chassis"]["mass_kg"]
    assert config.sigmas["vehicle.chassis.mass_kg"] == pytest.approx(0.15 * own["chassis"]["mass_kg"])
    assert all(config.sigmas[key] > 0 or config_value(own, key) in (0, 2, 8, 10) for key in config.of_class)


def config_value(own: dict[str, object], key: str) -> object:
    here: object = {"vehicle": own}
    for step in key.split("."):
        assert isinstance(here, dict)
        here = here[int(step) if step.isdigit() else step]
    return here


def test_what_the_file_says_counts(tmp_path: Path) -> None:
    vehicle = brochure("compact_dct7_dry") | {
        "chassis": {"mass_kg": {"value": 1395, "sigma": 40}},
        "engine_inertia_kgm2": 0.11,
    }
    config = load_config(written(tmp_path, vehicle))
    assert config.settings.vehicle.chassis.mass_kg == 1395
    assert config.settings.vehicle.engine_inertia_kgm2 == 0.11
    assert config.settings.vehicle.chassis.drag_coefficient == 0.31
    assert config.sigmas["vehicle.chassis.mass_kg"] == 40
    assert "vehicle.engine_inertia_kgm2" not in config.sigmas
    assert "vehicle.chassis.mass_kg" not in config.of_class


def test_the_nearest_class_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(written(tmp_path, brochure("compact_dct7_dry") | {"class": "compact_dct7"}))
    (problem,) = caught.value.problems
    assert (problem.key, problem.value) == ("vehicle", "compact_dct7")
    assert "did you mean compact_dct7_dry" in problem.reason


def test_without_ratios_each_one_is_asked_for(tmp_path: Path) -> None:
    vehicle = brochure("compact_dct7_dry") | {"gears": {1: {"shaft": 1, "final_drive": 4.44}}}
    with pytest.raises(ConfigError) as caught:
        load_config(written(tmp_path, vehicle))
    assert "vehicle.gears.1.ratio" in {problem.key for problem in caught.value.problems}


@pytest.mark.parametrize("sigma", ["broad", -1, True])
def test_a_sigma_is_a_number(sigma: object, tmp_path: Path) -> None:
    vehicle = brochure("compact_dct7_dry") | {"chassis": {"mass_kg": {"value": 1395, "sigma": sigma}}}
    with pytest.raises(ConfigError) as caught:
        load_config(written(tmp_path, vehicle))
    assert [problem.key for problem in caught.value.problems] == ["vehicle.chassis.mass_kg.sigma"]
