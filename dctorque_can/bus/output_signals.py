"""What each message of ``dbc/dctorque.dbc`` holds of an estimate."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.pipeline.estimates import Status

Column = NDArray[np.float64]

RPM = 30.0 / math.pi  # of one rad/s
REVERSE_CODE = 13.0  # gear of the value tables GearShaft1 and GearShaft2
ENGAGEMENT_MODULUS = 255  # of Clutch1Engagements and Clutch2Engagements
STARTING, ESTIMATING, DEGRADED = 0.0, 1.0, 2.0  # value tables Dct…State


def _torques(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    valid1, valid2 = _has(rows, Status.CLUTCH1_VALID), _has(rows, Status.CLUTCH2_VALID)
    return {
        "Clutch1TorqueValid": _flag(valid1),
        "Clutch2TorqueValid": _flag(valid2),
        "DctClutchTorqueState": state,
        "Clutch1Torque": _where(valid1, rows["clutch1_torque_nm"]),
        "Clutch2Torque": _where(valid2, rows["clutch2_torque_nm"]),
        "ClutchTorqueSum": _where(valid1 & valid2, rows["clutch_torque_sum_nm"]),
    }


def _driveline(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    valid, learned = _has(rows, Status.OUTPUT_VALID), _has(rows, Status.ROAD_LOAD_LEARNED)
    return {
        "OutputTorqueValid": _flag(valid),
        "RoadLoadLearned": _flag(learned),
        "DctDrivelineState": state,
        "OutputTorque": _where(valid, rows["output_torque_nm"]),
        "OutputTorqueAdaptive": _where(valid & learned, rows["output_torque_adaptive_nm"]),
        "RoadLoadTorque": _where(learned, rows["road_load_nm"]),
    }


def _slips(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    valid = ~_has(rows, Status.INPUT_STALE)
    gears, phases = _has(rows, Status.GEARS_KNOWN), _has(rows, Status.PHASES_KNOWN)
    return {
        "ClutchSlipValid": _flag(valid),
        "DctClutchSlipState": state,
        "Clutch1Slip": _where(valid, rows["clutch1_slip_rad_s"] * RPM),
        "Clutch2Slip": _where(valid, rows["clutch2_slip_rad_s"] * RPM),
        "Clutch1Phase": _where(phases & (rows["phase1"] <= ClutchPhase.LOCKED), rows["phase1"]),
        "Clutch2Phase": _where(phases & (rows["phase2"] <= ClutchPhase.LOCKED), rows["phase2"]),
        "GearShaft1": _where(gears, np.where(rows["gear1"] < 0, REVERSE_CODE, rows["gear1"])),
        "GearShaft2": _where(gears, np.where(rows["gear2"] < 0, REVERSE_CODE, rows["gear2"])),
    }


def _status(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    return {
        "DctStatusState": state,
        "Clutch1Valid": _flag(_has(rows, Status.CLUTCH1_VALID)),
        "Clutch2Valid": _flag(_has(rows, Status.CLUTCH2_VALID)),
        "OutputValid": _flag(_has(rows, Status.OUTPUT_VALID)),
        "GearsKnown": _flag(_has(rows, Status.GEARS_KNOWN)),
        "PhasesKnown": _flag(_has(rows, Status.PHASES_KNOWN)),
        "RoadLoadKnown": _flag(_has(rows, Status.ROAD_LOAD_LEARNED)),
        "Converged": _flag(_has(rows, Status.CONVERGED)),
        "InputStale": _flag(_has(rows, Status.INPUT_STALE)),
        "SpeedImplausible": _flag(_has(rows, Status.SPEED_IMPLAUSIBLE)),
        "EstimateLimited": _flag(_has(rows, Status.LIMITED)),
        "EngineTorqueEstimate": _where(~_has(rows, Status.INPUT_STALE), rows["engine_torque_nm"]),
        "EngineSpeedFault": _flag(_has(rows, Status.ENGINE_SPEED_FAULT)),
        "Shaft1SpeedFault": _flag(_has(rows, Status.SHAFT1_SPEED_FAULT)),
        "Shaft2SpeedFault": _flag(_has(rows, Status.SHAFT2_SPEED_FAULT)),
        "DrivenWheelsFault": _flag(_has(rows, Status.DRIVEN_WHEELS_FAULT)),
        "UndrivenWheelsFault": _flag(_has(rows, Status.UNDRIVEN_WHEELS_FAULT)),
        "EngineTorqueFault": _flag(_has(rows, Status.ENGINE_TORQUE_FAULT)),
    }


def _uncertainty(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    sigma1, sigma2, output = rows["clutch1_sigma_nm"], rows["clutch2_sigma_nm"], rows["output_sigma_nm"]
    known1 = _has(rows, Status.CLUTCH1_VALID) & (sigma1 > 0.0)  # NaN: the method states none
    known2 = _has(rows, Status.CLUTCH2_VALID) & (sigma2 > 0.0)
    known = _has(rows, Status.OUTPUT_VALID) & (output > 0.0)
    return {
        "Clutch1SigmaValid": _flag(known1),
        "Clutch2SigmaValid": _flag(known2),
        "OutputSigmaValid": _flag(known),
        "DctUncertaintyState": state,
        "Clutch1Sigma": _where(known1, sigma1),
        "Clutch2Sigma": _where(known2, sigma2),
        "OutputSigma": _where(known, output),
        "ClutchCorrelation": _where(known1 & known2, rows["clutch_correlation"]),
    }


def _powers(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    known = _has(rows, Status.PHASES_KNOWN)
    known1, known2 = known & _has(rows, Status.CLUTCH1_VALID), known & _has(rows, Status.CLUTCH2_VALID)
    return {
        "Clutch1PowerValid": _flag(known1),
        "Clutch2PowerValid": _flag(known2),
        "DctClutchPowerState": state,
        "Clutch1Power": _where(known1, rows["clutch1_power_w"]),
        "Clutch2Power": _where(known2, rows["clutch2_power_w"]),
    }


def _energies(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    known1, known2 = _has(rows, Status.ENERGY1_KNOWN), _has(rows, Status.ENERGY2_KNOWN)
    return {
        "Clutch1EnergyValid": _flag(known1),
        "Clutch2EnergyValid": _flag(known2),
        "DctClutchEnergyState": state,
        "Clutch1Energy": _where(known1, rows["clutch1_energy_j"]),
        "Clutch2Energy": _where(known2, rows["clutch2_energy_j"]),
        "Clutch1Engagements": (rows["clutch1_engagements"] % ENGAGEMENT_MODULUS).astype(np.float64),
        "Clutch2Engagements": (rows["clutch2_engagements"] % ENGAGEMENT_MODULUS).astype(np.float64),
    }


def _residuals(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    valid1, valid2 = _has(rows, Status.CLUTCH1_VALID), _has(rows, Status.CLUTCH2_VALID)
    known1, known2 = valid1 & _has(rows, Status.RESIDUAL1_KNOWN), valid2 & _has(rows, Status.RESIDUAL2_KNOWN)
    both = valid1 & valid2
    return {
        "Clutch1ResidualValid": _flag(known1),
        "Clutch2ResidualValid": _flag(known2),
        "DctClutchResidualState": state,
        "Clutch1Residual": _where(known1, rows["clutch1_residual_nm"]),
        "Clutch2Residual": _where(known2, rows["clutch2_residual_nm"]),
        "RecirculatedTorque": _where(both, rows["recirculated_torque_nm"]),
        "TieUpProbability": _where(both & _has(rows, Status.TIE_UP_KNOWN), rows["tie_up_probability"]),
    }


def _temperatures(rows: NDArray[np.void], state: Column) -> dict[str, Column]:
    known1, known2 = _has(rows, Status.TEMPERATURE1_KNOWN), _has(rows, Status.TEMPERATURE2_KNOWN)
    return {
        "Clutch1TemperatureValid": _flag(known1),
        "Clutch2TemperatureValid": _flag(known2),
        "DctClutchTemperatureState": state,
        "Clutch1Temperature": _where(known1, rows["clutch1_temperature_c"]),
        "Clutch2Temperature": _where(known2, rows["clutch2_temperature_c"]),
    }


CONTENTS: dict[str, Callable[[NDArray[np.void], Column], dict[str, Column]]] = {
    "DctClutchTorque": _torques,
    "DctDriveline": _driveline,
    "DctClutchSlip": _slips,
    "DctStatus": _status,
    "DctUncertainty": _uncertainty,
    "DctClutchPower": _powers,
    "DctClutchEnergy": _energies,
    "DctClutchResidual": _residuals,
    "DctClutchTemperature": _temperatures,
}
"""Physical values of each message by signal name, in the unit of the DBC; NaN where a value is not valid, or not
known with the method (`estimates.ONLY_KALMAN`, `estimates.ONLY_OH2014`)."""

_DEGRADED_BITS = np.uint32(Status.INPUT_STALE | Status.SPEED_IMPLAUSIBLE | Status.LIMITED)
_CONVERGED_BIT = np.uint32(Status.CONVERGED)


def _has(rows: NDArray[np.void], bit: Status) -> NDArray[np.bool_]:
    return np.asarray(rows["status"] & int(bit), np.bool_)


def _flag(is_set: NDArray[np.bool_]) -> Column:
    return is_set.astype(np.float64)


def _where(valid: NDArray[np.bool_], value: NDArray[np.float64]) -> Column:
    return np.where(valid, value, np.nan)


def states(status: NDArray[np.uint32]) -> Column:
    """Return the value of the value tables Dct…State, ``[n]``."""
    running = np.where(status & _DEGRADED_BITS, DEGRADED, ESTIMATING)
    return np.where(status & _CONVERGED_BIT, running, STARTING)
