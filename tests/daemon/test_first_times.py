"""Nothing is done for the first time while frames wait: no import, no machine code made or loaded."""

import gc
import json
import subprocess
import sys
from pathlib import Path

import can
import numpy as np

from dctorque_can.chain import Chain
from dctorque_can.config.load import Config, load_config
from dctorque_can.daemon.service import Service
from dctorque_can.offline.simulated_car import SimulatedDrive
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.resources import shipped_config

from .conftest import HANG_S


def test_nothing_is_imported_or_compiled_after_the_service_is_prepared(
    tmp_path: Path, folder: Path, drive: SimulatedDrive
) -> None:
    """With gaps, faults, rotation, refused identifiers, a clock that is set, and a log writer that is killed.

    Such a thing once held up the receive loop for half a second on a busy computer.
    """
    frames = drive.frames
    columns = {name: getattr(frames, name) for name in ("t_us", "can_id", "length", "flags", "channel", "data")}
    np.savez(tmp_path / "drive.npz", **columns)
    words = [tmp_path / "drive.npz", folder]
    done = subprocess.run(
        [sys.executable, Path(__file__).with_name("eventful.py"), *words],
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["modules"] == []
    assert found["functions"] == []
    assert found["sent"] > 100
    written, dropped, received = found["log"]
    assert dropped == 0
    assert written > received > 2500


def test_a_chain_that_is_warm_has_found_its_machine_code_for_few_and_for_many_frames() -> None:
    chain = Chain(load_config(shipped_config("paper_car")))
    chain.warm_up()
    empty = Chain(load_config(shipped_config("paper_car")))
    warm, fresh = chain.state(), empty.state()
    assert warm.values == fresh.values  # it has changed nothing
    for name, array in warm.arrays.items():
        np.testing.assert_array_equal(array, fresh.arrays[name], err_msg=name)
    assert isinstance(chain._estimator, Estimator)
    assert chain._estimator._run_small is not None
    assert {"_layouts", "_identity"} <= vars(chain).keys()


def test_what_was_there_before_the_run_is_not_looked_through_for_garbage(
    config: Config,
) -> None:
    """A full collection over everything that is imported takes a tenth of a second of processor time."""
    seen: list[tuple[int, int]] = []

    class Ending(can.BusABC):
        channel_info = "ending"

        def __init__(self) -> None:
            super().__init__("ending")

        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            raise AssertionError("nothing is sent")

        def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
            seen.append((gc.get_freeze_count(), len(gc.get_objects())))
            service.stop()
            return None, True

    service = Service(config, [Ending], None, lambda is_error, text: None)
    service.prepare()
    service._stop = False  # what it received meanwhile is no matter
    objects = len(gc.get_objects())
    service.run()
    frozen, young = seen[-1]
    assert frozen > 0.9 * objects
    assert young < 0.1 * objects
    assert gc.get_freeze_count() == 0
