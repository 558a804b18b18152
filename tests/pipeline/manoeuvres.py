"""Simulated manoeuvres as frames, and for how long their estimates are confidently wrong."""

from dataclasses import replace
from functools import cache

import numpy as np

from dctorque_can.analysis.confidence import lasting_ms, wrong
from dctorque_can.config.load import Config, load_config
from dctorque_can.pipeline.frames import Frames
from dctorque_can.resources import shipped_config
from dctorque_can.simulation.drive import simulate
from dctorque_can.simulation.manoeuvres import MANOEUVRES
from dctorque_can.simulation.sensors import PRODUCTION, emit_frames

SIGNED_DBC = {"databases.0.file": "../dbc/demo_car_signed.dbc"}
MAGNITUDES = frozenset({"wheels", "shafts"})
TORQUES = {"clutch1_nm": "clutch1", "clutch2_nm": "clutch2", "output_nm": "output"}


@cache
def config(car, signed=False):
    return load_config(shipped_config(car), SIGNED_DBC if signed else {})


@cache
def driven(car, name):
    vehicle = config(car).settings.vehicle
    return simulate(vehicle, MANOEUVRES[name](vehicle))


def frames_of(of: Config, truth, unsigned) -> Frames:
    profile = replace(PRODUCTION, seed=4, unsigned=frozenset(unsigned))
    return emit_frames(truth, of.settings.vehicle, profile, of.database)


def wrong_ms(rows, truth):
    found = {}
    for name, column in TORQUES.items():
        torque = f"{column}_torque_nm"
        error = rows[torque] - np.interp(rows["t_us"], truth["t_us"], truth[torque])
        beyond = wrong(name, error, rows[f"{column}_sigma_nm"], rows["status"])
        found[name] = lasting_ms(rows["t_us"])[beyond].sum()
    return found
