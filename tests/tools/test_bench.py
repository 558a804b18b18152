"""``tools/bench --against``: measured in turns, and the names under which this checkout has what is measured."""

import importlib
import importlib.util
import lzma
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ROOT / "tools"
DRIVE = ROOT / "tests" / "golden" / "drives" / "paper_car_production.log.xz"
HANG_S = 900  # so late that no load of the machine explains it


@pytest.fixture
def ratios(monkeypatch):
    monkeypatch.syspath_prepend(str(TOOLS))
    return importlib.import_module("ratios")


@pytest.fixture
def names():
    spec = importlib.util.spec_from_file_location("names", TOOLS / "measured" / "now" / "names.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "drive.log"
    path.write_bytes(lzma.decompress(DRIVE.read_bytes()))
    return path


def test_sides_take_turns_and_each_round_has_its_ratio(ratios):
    """A machine that slows down to a third moves both medians, and not the ratio."""
    called = []

    def of(side):
        called.append(side.name)
        return (1.0 if side.name == "old" else 2.0) * (1.0, 2.0, 3.0)[(len(called) - 1) // 2]

    old, new = (ratios.Side(name, Path(), Path()) for name in ("old", "new"))
    found = ratios.in_turns(ratios.Measurement("nothing, s", of), old, new, 3)
    assert called == ["old", "new", "new", "old", "old", "new"]
    assert (found.commit, found.checkout) == (2.0, 4.0)
    assert (found.ratio, found.lowest, found.highest) == (2.0, 2.0, 2.0)
    assert "nothing, s" in ratios.told("old", [found])


def test_the_names_of_this_checkout_lead_to_what_is_measured(names, log):
    config = names.kalman_config("paper_car")
    frames = names.frames_of(log)
    at_once = names.new_feed(config)(names.decoded(config, frames))
    live = names.new_live_feed(config)
    assert len(at_once) == sum(len(live(message)) for message in names.messages_of(log, len(frames)))
    assert len(at_once) > 2000
    assert {m.name for m in names.mapped_messages(config).values()} == {
        "EngineData",
        "InputShafts",
        "Gearbox",
        "WheelSpeedsFront",
        "WheelSpeedsRear",
    }


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--rounds", "0", "--against", "HEAD"], "--rounds must be"),
        (["--minutes", "0"], "minutes are positive"),
        (["--sections", "live,dead"], "sections"),
    ],
)
def test_wrong_usage_exits_with_2(arguments, complaint):
    command = [sys.executable, TOOLS / "bench", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S)
    assert (done.returncode, done.stdout) == (2, "")
    assert complaint in done.stderr
