"""Cars in traffic, and the mistakes of their vehicle files, as tools/plausibility measures them."""

import importlib
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture(scope="session")
def cases():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(TOOLS))
        return importlib.import_module("wrong_files")


@pytest.fixture(scope="session")
def drives(cases):
    """By car, its right vehicle file and the frames of 40 s in traffic."""
    return {car: cases.in_traffic(car, 1, seconds=40.0) for car in cases.CARS}
