"""A gearbox that loses torque in whatever turns: told it is allowed for, not told it is in σ."""

from dataclasses import replace

import numpy as np
import pytest

from dctorque_can.bus.decoder import Decoder
from dctorque_can.config.load import load_config
from dctorque_can.pipeline.estimates import Status
from dctorque_can.pipeline.estimator import Estimator
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.manoeuvres import MANOEUVRES

from .manoeuvres import config, frames_of, wrong_ms

TOLD = {
    f"vehicle.shafts.{shaft}.{key}": value
    for shaft in (1, 2)
    for key, value in (("spin_loss_nm", "1"), ("spin_loss_nms_per_rad", "0.008"))
}
"""3 N·m of each shaft at 250 rad/s: twice the drag of a dry gearbox with warm oil."""


@pytest.mark.parametrize("car", ["paper_car", "avante_dct7"])
def test_untold_losses_are_in_the_bands_and_told_ones_in_the_torque(car):
    lossy = load_config(shipped_config(car), TOLD)
    vehicle = lossy.settings.vehicle
    truth = simulate(vehicle, replace(MANOEUVRES["braked_coast_down"](vehicle), duration_s=20.0))
    frames = frames_of(config(car), truth, ())
    errors = {}
    for name, of in (("told", lossy), ("untold", config(car))):
        rows = Estimator(of.settings).feed(Decoder(of.database, of.inputs, of.protections).decode(frames)).rows
        assert max(wrong_ms(rows, truth).values()) == 0.0
        rows = rows[rows["status"] & Status.OUTPUT_VALID > 0]
        error = rows["output_torque_nm"] - np.interp(rows["t_us"], truth["t_us"], truth["output_torque_nm"])
        assert np.mean(np.abs(error) < 1.96 * rows["output_sigma_nm"]) > 0.9
        errors[name] = np.sqrt(np.mean(error**2))
    assert errors["told"] < 0.7 * errors["untold"]
