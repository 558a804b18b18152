"""The headline numbers of docs/paper.md, and that its page, its figures and its command fit each other."""

import importlib
import re
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
TABLE_1 = np.array([2.124, 3.403, 67.233])


@pytest.fixture
def page(monkeypatch):
    """Return a function that imports a module of tools/paper."""
    monkeypatch.syspath_prepend(str(ROOT / "tools" / "paper"))
    return importlib.import_module


def test_table_1_is_met(page):
    """RMS of clutch 1, clutch 2 and output torque over the paper's drive, mean of three seeds of noise."""
    cases = page("cases")
    frames = {seed: cases.paper_frames(seed) for seed in (4, 5, 6)}
    errors = cases.score(cases.car("paper_car"), frames, cases.paper_truth()).rms.mean(axis=0)
    assert np.all(errors <= TABLE_1)
    literal = cases.score(cases.car("paper_car", road_load="none"), frames, cases.paper_truth()).rms.mean(axis=0)
    assert np.all(literal > TABLE_1)  # (47) without a known road load cannot hold a hill


def test_the_order_of_section_4_2(page, monkeypatch):
    """Output torque of the section 2.3 car: clutch torques before adaptive observer before map, on one drive."""
    vehicle42 = page("vehicle42")
    monkeypatch.setattr(vehicle42, "SEEDS", (21,))
    monkeypatch.setattr(vehicle42, "DRIVE_S", 180.0)
    _, table = vehicle42.comparison()
    for ground in ("level", "hilly"):
        row = next(line for line in table.splitlines() if f"{ground} road, road_load: learned" in line)
        ratios = [float(ratio) for ratio in re.findall(r"×([\d.]+)", row)]
        assert ratios[0] == 1.0 < ratios[1] < ratios[2]


def row_of(mark, name):
    """Return the numbers of a row of a table of the page."""
    content = PAGE.split(f"<!-- {mark} -->\n")[1].split(f"<!-- /{mark} -->")[0]
    row = next(line for line in content.splitlines() if line.startswith(f"| {name}"))
    return [float(cell.split(" ± ")[0]) for cell in row.split("|")[2:-1] if cell.strip()]


def test_the_page_says_what_is_measured(page):
    """A row of three tables: Table 1 on a few of its seeds, an open-loop run, and the tie-up."""
    cases, models = page("cases"), page("models")
    frames = {seed: cases.paper_frames(seed) for seed in range(1, 6)}
    errors = cases.score(cases.car("paper_car"), frames, cases.paper_truth()).rms.mean(axis=0)
    np.testing.assert_allclose(row_of("table1", "ours, full observer"), errors, rtol=0.08)
    for run, mark, name in (
        (models.validation, "open_loop", "section 4.1 car, down-shift, compliant"),
        (models.recirculation, "recirculation", "section 2.3 car, conventional"),
    ):
        _, table = run()
        found = next(line for line in table.splitlines() if line.startswith(f"| {name}"))
        np.testing.assert_allclose(
            row_of(mark, name), [float(cell) for cell in found.split("|")[2:-1]], rtol=0.02, atol=0.02
        )


def test_the_command_fills_the_page():
    script = (ROOT / "tools" / "paper" / "__main__.py").read_text(encoding="utf-8")
    marks = set(re.findall(r"<!-- (\w+) -->", PAGE))
    assert marks >= {"table1", "variants", "vehicle"}
    for mark in marks:
        assert f'"{mark}": ' in script
        content = PAGE.split(f"<!-- {mark} -->\n")[1].split(f"<!-- /{mark} -->")[0]
        assert content.startswith("| ")
    images = set(re.findall(r"\(images/paper/(\w+\.png)\)", PAGE))
    assert images == {path.name for path in (ROOT / "docs" / "images" / "paper").iterdir()}
