"""Logs of any kind through the chain: whole, cut off, in parts, with and without their configuration."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dctorque_can.config.load import Config, load_config, load_documents
from dctorque_can.errors import DctorqueError
from dctorque_can.logs.convert import write_frames
from dctorque_can.logs.mcap.reader import read_table
from dctorque_can.logs.mcap.table import ESTIMATES, HEALTH
from dctorque_can.logs.output_file import refuse_existing
from dctorque_can.logs.reader import open_log
from dctorque_can.offline.replay import ReplayContent, ReplayResult, ReplayTargets, config_of, replay_logs
from dctorque_can.offline.simulated_car import SimulatedDrive, write_log
from dctorque_can.resources import shipped_config


def run(paths: list[Path], config: Config, output: Path, content: ReplayContent | None = None) -> ReplayResult:
    logs = [open_log(path) for path in paths]
    return replay_logs(logs, config, ReplayTargets(output), content or ReplayContent(), lambda fraction: None)


@pytest.fixture
def log(config: Config, drive: SimulatedDrive, tmp_path: Path) -> Path:
    write_log(config, drive, tmp_path / "drive.mcap")
    return tmp_path / "drive.mcap"


def test_two_parts_are_one_sequence(config: Config, drive: SimulatedDrive, tmp_path: Path) -> None:
    whole, one, two = (tmp_path / f"{name}.mcap" for name in ("whole", "one", "two"))
    write_frames(whole, drive.frames)
    write_frames(one, drive.frames[:1111])
    write_frames(two, drive.frames[1111:])
    run([whole], config, tmp_path / "a.mcap")
    run([one, two], config, tmp_path / "b.mcap")
    a, b = (read_table(tmp_path / name, ESTIMATES) for name in ("a.mcap", "b.mcap"))
    assert a.tobytes() == b.tobytes()


def test_a_log_brings_its_configuration_and_overrides_reach_it(log: Path) -> None:
    with open_log(log) as reader:
        assert config_of([reader], {}).name == "paper car"
        slower = config_of([reader], {"estimator.period_ms": "50"})
    assert slower.settings.estimate_period_us == 50_000


def test_a_log_without_configuration_asks_for_one(drive: SimulatedDrive, tmp_path: Path) -> None:
    write_frames(tmp_path / "bare.blf", drive.frames[:10])
    with open_log(tmp_path / "bare.blf") as reader, pytest.raises(DctorqueError, match="--config"):
        config_of([reader], {})


def test_the_result_holds_what_was_asked_for(log: Path, config: Config, tmp_path: Path) -> None:
    output = tmp_path / "all.mcap"
    result = run([log], config, output, ReplayContent(frames=True, signals=True, truth=True))
    assert result.errors is not None
    assert result.errors["clutch1_nm"].rms < 10
    assert len(read_table(output, ESTIMATES)) == result.estimates
    assert len(read_table(output, "/signals/Gearbox")) == pytest.approx(result.frames / 4, abs=2)
    assert len(read_table(output, "/dctorque/truth")) == 7001
    with open_log(output) as reader:
        assert sum(len(frames) for frames in reader.frames()) == result.frames
        assert reader.documents == config.documents


def test_a_cut_off_log_is_used_as_far_as_it_goes(log: Path, config: Config, tmp_path: Path) -> None:
    whole = run([log], config, tmp_path / "whole.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    part = run([cut], config, tmp_path / "part.mcap")
    assert 0 < part.frames <= whole.frames
    assert part.problems
    assert "cut.mcap" in part.problems[0]
    estimates = read_table(tmp_path / "part.mcap", ESTIMATES)
    assert estimates.tobytes() == read_table(tmp_path / "whole.mcap", ESTIMATES)[: len(estimates)].tobytes()


def test_smoothed_estimates_are_in_everything_that_is_written(log: Path, config: Config, tmp_path: Path) -> None:
    """Rows at the times of the online ones, less wrong and surer; the same frames, signals and health."""
    content = ReplayContent(frames=True, signals=True, truth=True)
    config = load_config(shipped_config("paper_car"))
    online = run([log], config, tmp_path / "online.mcap", content)
    result = run([log], config, tmp_path / "smoothed.mcap", replace(content, smooth=True))
    assert (online.smoothed, result.smoothed) == (False, True)
    assert result.errors is not None
    assert online.errors is not None
    for torque in ("clutch1_nm", "clutch2_nm", "output_nm"):
        assert result.errors[torque].rms < online.errors[torque].rms
    for name in ("frames", "estimates", "never_received", "bus_seconds", "problems", "health"):
        assert getattr(result, name) == getattr(online, name)
    before, after = (read_table(tmp_path / name, ESTIMATES) for name in ("online.mcap", "smoothed.mcap"))
    assert len(after) == result.estimates
    changed = {name for name in before.dtype.names if before[name].tobytes() != after[name].tobytes()} - {"status"}
    assert changed == {
        *("clutch1_torque_nm", "clutch2_torque_nm", "output_torque_nm"),
        *("clutch1_sigma_nm", "clutch2_sigma_nm", "output_sigma_nm", "clutch_correlation"),
        "clutch_torque_sum_nm",
    }
    assert (after["clutch1_sigma_nm"] <= before["clutch1_sigma_nm"]).all()
    for topic in (HEALTH, "/signals/Gearbox", "/dctorque/truth"):
        assert read_table(tmp_path / "smoothed.mcap", topic).tobytes() == (
            read_table(tmp_path / "online.mcap", topic).tobytes()
        )
    with open_log(tmp_path / "smoothed.mcap") as reader:
        assert sum(len(frames) for frames in reader.frames()) == result.frames
        assert "smoothed" in reader.metadata["estimates"]
    with open_log(tmp_path / "online.mcap") as reader:
        assert "estimates" not in reader.metadata


def test_smoothing_goes_over_all_parts_of_a_recording(
    config: Config, drive: SimulatedDrive, tmp_path: Path
) -> None:
    names = ("whole", "one", "two")
    whole, one, two = (tmp_path / f"{name}.mcap" for name in names)
    for path, frames in zip(
        (whole, one, two), (drive.frames, drive.frames[:1111], drive.frames[1111:]), strict=True
    ):
        write_frames(path, frames)
    smooth = ReplayContent(smooth=True)
    run([whole], config, tmp_path / "a.mcap", smooth)
    run([one, two], config, tmp_path / "b.mcap", smooth)
    run([one], config, tmp_path / "c.mcap", smooth)
    a, b, c = (read_table(tmp_path / f"{name}.mcap", ESTIMATES) for name in "abc")
    assert a.tobytes() == b.tobytes()
    assert a[: len(c)].tobytes() != c.tobytes()  # it stands on both parts


def test_a_cut_off_log_is_smoothed_as_far_as_it_goes(log: Path, config: Config, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    part = run([cut], config, tmp_path / "part.mcap", ReplayContent(smooth=True))
    assert part.problems
    assert len(read_table(tmp_path / "part.mcap", ESTIMATES)) == part.estimates > 0


def test_a_log_without_a_known_frame_has_nothing_to_smooth(
    config: Config, drive: SimulatedDrive, tmp_path: Path
) -> None:
    strange = replace(drive.frames[:50], can_id=drive.frames.can_id[:50] + np.uint32(0x400))
    for name, frames in (("strange", strange), ("empty", drive.frames[:0])):
        write_frames(tmp_path / f"{name}.mcap", frames)
        result = run([tmp_path / f"{name}.mcap"], config, tmp_path / "out.mcap", ReplayContent(smooth=True))
        assert (result.frames, result.estimates) == (len(frames), 0)


@pytest.mark.parametrize("smooth", [False, True])
def test_truth_without_a_frame_is_one_clear_error(
    config: Config, drive: SimulatedDrive, tmp_path: Path, smooth: bool
) -> None:
    write_log(config, replace(drive, frames=drive.frames[:0]), tmp_path / "empty.mcap")
    with pytest.raises(DctorqueError, match="there is nothing to compare"):
        run([tmp_path / "empty.mcap"], config, tmp_path / "out.mcap", ReplayContent(truth=True, smooth=smooth))


def test_the_2014_observer_is_not_smoothed_and_nothing_is_written(
    log: Path, config: Config, tmp_path: Path
) -> None:
    observer = load_documents(config.documents, {"estimator.method": "oh2014"})
    with pytest.raises(DctorqueError, match=r"oh2014.*estimator\.method=kalman"):
        run([log], observer, tmp_path / "out.mcap", ReplayContent(smooth=True))
    assert not (tmp_path / "out.mcap").exists()


def test_a_failure_leaves_no_half_result(log: Path, config: Config, tmp_path: Path) -> None:
    bare = tmp_path / "bare.mcap"
    write_frames(bare, open_frames(log))
    with pytest.raises(DctorqueError, match="/dctorque/truth"):
        run([bare], config, tmp_path / "out.mcap", ReplayContent(truth=True))
    assert not (tmp_path / "out.mcap").exists()


def open_frames(path: Path):
    with open_log(path) as reader:
        yield from reader.frames()


def test_a_full_disk_is_one_clear_error(log: Path, config: Config) -> None:
    with pytest.raises(DctorqueError, match=r"/dev/full.*No space left"):
        run([log], config, Path("/dev/full"))


@pytest.mark.parametrize(
    ("name", "force", "text"),
    [
        ("old.mcap", False, "exists already"),
        ("input.blf", True, "is an input too"),
        ("folder", True, "is a directory"),
        ("nowhere/new.mcap", True, "no such directory"),
        ("new.mcap", False, ""),
        ("old.mcap", True, ""),
    ],
)
def test_nothing_is_overwritten_by_accident(tmp_path: Path, name: str, force: bool, text: str) -> None:
    for existing in ("old.mcap", "input.blf"):
        (tmp_path / existing).touch()
    (tmp_path / "folder").mkdir()
    if text:
        with pytest.raises(DctorqueError, match=text):
            refuse_existing(tmp_path / name, [tmp_path / "input.blf"], force)
    else:
        refuse_existing(tmp_path / name, [tmp_path / "input.blf"], force)
