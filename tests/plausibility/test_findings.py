"""Each finding is one sentence that names a number, the cause and the key of the vehicle file to look at."""

import re

import pytest
import yaml

from dctorque_can.plausibility.findings import N_FINDINGS, Finding, sentences
from dctorque_can.resources import shipped_config


@pytest.fixture(scope="module")
def document():
    return yaml.safe_load(shipped_config("avante_dct7").read_text(encoding="utf-8"))


@pytest.mark.parametrize("finding", Finding)
def test_its_keys_exist(finding, document):
    ((found, measured, sentence),) = sentences(int(finding), [0.25] * N_FINDINGS, 3)
    assert (found, measured) == (finding, 0.25)
    _, look = sentence.split("Look at ")
    keys = re.findall(r"(?:vehicle|inputs|gears|clutch_phase)[\w.]*", look)
    assert keys
    for key in keys:
        node = document
        for step in key.split("."):
            node = node[int(step) if step.isdigit() else step]


def test_a_mask_gives_its_findings_in_order():
    both = Finding.MASS | Finding.GEAR_RATIO
    assert [found for found, _, _ in sentences(int(both), [0.0] * N_FINDINGS, 1)] == [
        Finding.GEAR_RATIO,
        Finding.MASS,
    ]
    assert list(sentences(0, [0.0] * N_FINDINGS, 1)) == []
