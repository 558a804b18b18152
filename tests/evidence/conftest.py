"""Cars in traffic, two of them with a bus of their own, and the mistakes of any vehicle file."""

import importlib
from pathlib import Path

import pytest

from dctorque_can.config.load import load_config, load_documents
from dctorque_can.resources import shipped_config
from dctorque_can.study.invented_car import invent_car

TOOLS = Path(__file__).resolve().parents[2] / "tools"
SECONDS = 150.0


@pytest.fixture(scope="session")
def tools():
    """Modules of tools/ by name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TOOLS))
        return {name: importlib.import_module(name) for name in ("wrong_files", "check_mistakes")}


@pytest.fixture(scope="session")
def cars(tools):
    """By name, a right vehicle file and the frames of a drive through traffic."""
    configs = {
        "avante": load_config(shipped_config("avante_dct7")),
        "invented": load_documents(invent_car(2).documents),
        "telling": load_documents(invent_car(3, tells_motion=True).documents),
    }
    drive = tools["wrong_files"].drive_in_traffic
    return {name: (config, drive(config, 5, SECONDS)) for name, config in configs.items()}
