"""Vehicle files that tell the estimator less, on simulated drives: it is unsure then, and never sure and wrong."""

import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.resources import shipped_config

from .manoeuvres import MAGNITUDES, driven, frames_of, wrong_ms

BY_RATIO = {"gears": "{source: ratio}"}
NO_BRAKE = {"inputs.brake": "null"}


@pytest.mark.parametrize(
    ("car", "drive", "wiring"),
    [
        # 98 and 88 ms, while a clutch near its kissing point had the σ of its drag
        ("paper_car", "touch_point_drift", {}),
        ("avante_dct7", "touch_point_drift", {}),
        # 1965, 70, 198 and 5065 ms, while a shaft with an open clutch counted as in the gear that it still fits
        ("paper_car", "tie_up", BY_RATIO),
        ("paper_car", "stop_start", BY_RATIO),
        ("avante_dct7", "sailing", BY_RATIO),
        ("avante_dct7", "reverse", BY_RATIO),
        # 1013, 567, 404, 485 ms, while a shaft that rang behind a closed clutch counted as in neutral
        ("paper_car", "roll_back", BY_RATIO),
        ("paper_car", "wheel_spin", BY_RATIO),
        ("paper_car", "split_mu", BY_RATIO),
        ("avante_dct7", "roll_back", BY_RATIO),
        # 1426 and 127 ms, while a brake that nothing tells of counted as off
        ("paper_car", "hard_braking", NO_BRAKE),
        ("avante_dct7", "hard_braking", NO_BRAKE),
    ],
)
def test_never_confidently_wrong(car, drive, wiring):
    of, truth = load_config(shipped_config(car), wiring), driven(car, drive)
    samples = Decoder(of.database, of.inputs, of.protections).decode(frames_of(of, truth, MAGNITUDES))
    rows = Estimator(of.settings).feed(samples).rows
    assert max(wrong_ms(rows, truth).values()) <= 50.0
    assert (rows["status"] & 7 == 7).mean() > 0.5
