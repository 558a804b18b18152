"""Sentences of docs/security.md that no other test holds."""

import os
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest

from dctorque_can.config.load import Config
from dctorque_can.daemon.log.plan import plan_for
from dctorque_can.daemon.log.process import LogProcess
from dctorque_can.daemon.service import Service
from dctorque_can.daemon.status.process import StatusPlaces, StatusProcess
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.pipeline.frames import Frames

Connect = Callable[[], can.BusABC]


def random_frames(config: Config, count: int, seed: int) -> Frames:
    """Return frames of mapped identifiers, of any length, content and flags, at times that jump now and then."""
    chance = np.random.default_rng(seed)
    names = {signal.message for each in config.inputs for signal in each.signals}
    ids = [message.frame_id for message in config.database.messages if message.name in names]
    frames = Frames.empty(count, 64)
    frames.t_us[:] = np.cumsum(chance.integers(0, 2_000, count))
    jumps = chance.random(count) < 0.001
    frames.t_us[jumps] = chance.integers(0, 1 << 50, int(jumps.sum()))
    frames.can_id[:] = chance.choice(ids, count)
    frames.length[:] = chance.integers(0, 65, count)
    frames.flags[:] = np.where(chance.random(count) < 0.1, chance.integers(0, 256, count), 0)
    frames.channel[:] = 0
    frames.data[:] = chance.integers(0, 256, frames.data.shape)
    return frames


def test_frames_of_any_content_stop_nothing_and_are_counted(config: Config, connect: Connect) -> None:
    service = Service(config, [connect], None, lambda is_error, text: None)
    service.prepare()
    frames = random_frames(config, 20_000, 1)
    for at in range(0, len(frames), 100):
        service._take(frames[at : at + 100], late=False)
    summary = service.run(0.0)
    assert summary.frames == len(frames)
    refused = summary.health["bad_crc"] | summary.health["bad_length"] | summary.health["bad_counter"]
    assert set(refused) == {each.quantity.name.lower() for each in config.inputs}
    assert np.isfinite(service._chain.health["speed_noise_rad_s"]).all()


def test_a_frame_with_a_wrong_checksum_changes_no_value(config: Config, drive: SimulatedDrive) -> None:
    from dctorque_can.bus.decoder import Decoder

    decoder = Decoder(config.database, config.inputs, config.protections, config.addresses)
    protected = {protection.message for protection in config.protections if protection.crc_signal}
    ids = [message.frame_id for message in config.database.messages if message.name in protected]
    frames = drive.frames[np.flatnonzero(np.isin(drive.frames.can_id, ids))[:200]]
    decoder.decode(frames)
    before = decoder.terms.tobytes()
    forged = frames.copy()
    forged.data[:, 1] ^= 0x55
    samples = decoder.decode(forged)
    assert decoder.terms.tobytes() == before
    assert not (samples.status == 0).any()


def test_modules_of_the_working_directory_are_not_imported(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Whoever may write where the service is started must not run code in its processes."""
    monkeypatch.chdir(tmp_path)
    for name in ("json", "asyncio", "numpy", "dctorque_can"):
        (tmp_path / f"{name}.py").write_text(f"import os; os.write(2, b'{name} of somebody else\\n'); os._exit(1)")
    log = LogProcess(plan_for(config, tmp_path / "x.mcap"), config.documents)
    log.open()
    log.close()
    status = StatusProcess(StatusPlaces(tmp_path / "status.sock"), lambda is_error, text: None)
    status.begin()
    status.wait_until_open(lambda: False)
    status.close()
    assert "somebody else" not in capfd.readouterr().err


def test_logs_are_made_for_user_and_group_alone_under_the_umask_of_the_unit(
    config: Config, tmp_path: Path
) -> None:
    before = os.umask(0o027)
    try:
        log = LogProcess(plan_for(config, tmp_path / "logs" / "x.mcap"), config.documents)
        (tmp_path / "logs").mkdir()
        log.open()
        log.close()
    finally:
        os.umask(before)
    assert (tmp_path / "logs" / "x.mcap").stat().st_mode & 0o777 == 0o640
