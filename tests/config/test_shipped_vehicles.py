"""The two vehicles that ship, against the tables of the paper, typed here again from sections 2.3 and 4.1."""

import pytest

from dctorque_can.config.load import load_config
from dctorque_can.driveline.parameters import Chassis, Clutch, Damper, DrivenAxle, Gear, OutputShaft, Shaft
from dctorque_can.pipeline.samples import Quantity
from dctorque_can.resources import find_config, shipped_config, shipped_configs, shipped_dbc


@pytest.mark.parametrize("path", shipped_configs(), ids=lambda path: path.stem)
def test_every_shipped_vehicle_loads_without_a_warning(path) -> None:
    assert load_config(path).warnings == ()


def test_the_car_of_section_4_1() -> None:
    vehicle = load_config(shipped_config("paper_car")).settings.vehicle
    assert vehicle.engine_inertia_kgm2 == 0.2
    assert vehicle.damper == Damper(0.03, 1500.0, 10.0)
    assert vehicle.shafts == (Shaft(0.0023, 10_000.0, 50.0), Shaft(0.0009, 23_000.0, 50.0))
    assert [(g.number, g.shaft, g.ratio, g.final_drive, g.inertia_kgm2) for g in vehicle.gears] == [
        (1, 1, 3.78, 3.7, 0.001),
        (2, 2, 2.18, 3.7, 0.001),
        (3, 1, 1.43, 3.7, 0.001),
        (4, 2, 1.03, 3.7, 0.001),
        (5, 1, 0.84, 3.7, 0.001),
    ]
    for clutch in vehicle.clutches:
        assert (clutch.effective_radius_m, clutch.friction_static, clutch.friction_kinetic) == (0.13, 0.31, 0.30)
        assert (clutch.surfaces, clutch.drag_nms_per_rad) == (4, 0.005)
    assert (vehicle.gear_efficiency, vehicle.final_drive_efficiency) == (0.94, 0.86)
    assert vehicle.output_shaft == OutputShaft(0.0002, 10_000.0, 20.0)
    assert vehicle.chassis == Chassis(1600.0, 0.312, 2.0, 0.015, 0.4, 3.0)


def test_the_car_of_section_2_3() -> None:
    vehicle = load_config(shipped_config("avante_dct7")).settings.vehicle
    assert vehicle.engine_inertia_kgm2 == 0.2
    assert vehicle.damper.inertia_kgm2 == 0.086
    assert vehicle.damper.damping_nms_per_rad == 10
    assert vehicle.shafts == (Shaft(0.043, 314_200.0, 53.0), Shaft(0.047, 301_200.0, 51.0))
    assert [vehicle.gear(n).ratio for n in range(1, 8)] == [3.688, 2.850, 1.387, 0.951, 0.943, 0.780, 0.674]
    assert [vehicle.gear(n).inertia_kgm2 for n in range(1, 8)] == [
        *(0.00602, 0.005415, 0.006926, 0.00737, 0.008503, 0.008973, 0.01102),
    ]
    assert [round(vehicle.gear(n).total_ratio, 2) for n in range(1, 8)] == [
        *(17.18, 10.26, 6.46, 4.43, 3.40, 2.81, 2.43),
    ]
    assert [g.number for g in vehicle.gears_on(1)] == [1, 3, 5, 7]
    assert [g.number for g in vehicle.gears_on(2)] == [-1, 2, 4, 6]
    assert vehicle.gear(-1) == Gear(-1, 2, -3.537, 4.657, 0.006432)
    first, second = vehicle.clutches
    assert (first.effective_radius_m, second.effective_radius_m) == (0.21, 0.1684)
    assert {first.friction_kinetic, second.friction_kinetic} == {0.27}
    assert vehicle.output_shaft == OutputShaft(0.04, 9520.0, 591.0)
    assert vehicle.chassis == Chassis(1596.0, 0.338, 1.7747, 0.015, 0.325, 2.2126)


@pytest.mark.parametrize(("name", "most_nm"), [("paper_car", 265.0), ("avante_dct7", 170.0)])
def test_each_clutch_can_carry_what_it_has_to(name: str, most_nm: float) -> None:
    def capacity(c: Clutch) -> float:
        return c.surfaces * c.friction_kinetic * c.effective_radius_m * c.max_normal_force_n

    for clutch in load_config(shipped_config(name)).settings.vehicle.clutches:
        assert 1.2 * most_nm < capacity(clutch) < 4 * most_nm


@pytest.mark.parametrize("name", ["paper_car", "avante_dct7"])
def test_the_demo_car_gives_every_input(name: str) -> None:
    config = load_config(shipped_config(name))
    given = {each.quantity for each in config.inputs}
    assert given >= set(range(Quantity.ENGINE_SPEED, Quantity.CLUTCH2_POSITION + 1))
    assert config.settings.driven_axle is DrivenAxle.FRONT
    assert {p.message: p.data_id for p in config.protections} == {
        "EngineData": 0x100,
        "InputShafts": 0x110,
        "Gearbox": 0x120,
        "WheelSpeedsFront": 0x130,
        "WheelSpeedsRear": 0x131,
    }
    assert all(p.crc == "e2e_p01" and p.counter_modulus == 15 for p in config.protections)


def test_shipped_files_are_found_by_name(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_config("paper_car") == shipped_config("paper_car.yaml")
    assert shipped_dbc("dctorque").name == "dctorque.dbc"
    (tmp_path / "paper_car.yaml").write_text("name: mine")
    assert find_config("paper_car.yaml").read_text() == "name: mine"
    assert str(find_config("elsewhere/car.yaml")) == "elsewhere/car.yaml"
