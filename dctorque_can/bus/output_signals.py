"""What each message of ``dbc/dctorque.dbc`` holds of an estimate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dctorque_can.compiled import compiled, compiled_without_allocation
from dctorque_can.driveline.phases import ClutchPhase
from dctorque_can.pipeline.estimates import ESTIMATE, Status

RPM = 30.0 / math.pi  # of one rad/s
REVERSE_CODE = 13.0  # gear of the value tables GearShaft1 and GearShaft2
ENGAGEMENT_MODULUS = 255  # of Clutch1Engagements and Clutch2Engagements
STARTING, ESTIMATING, DEGRADED = 0.0, 1.0, 2.0  # value tables Dct…State

CONTENTS: dict[str, tuple[str, ...]] = {
    "DctClutchTorque": (
        *("DctClutchTorqueState", "Clutch1TorqueValid", "Clutch2TorqueValid"),
        *("Clutch1Torque", "Clutch2Torque", "ClutchTorqueSum"),
    ),
    "DctDriveline": (
        *("DctDrivelineState", "OutputTorqueValid", "RoadLoadLearned"),
        *("OutputTorque", "OutputTorqueAdaptive", "RoadLoadTorque"),
    ),
    "DctClutchSlip": (
        *("DctClutchSlipState", "ClutchSlipValid", "Clutch1Slip", "Clutch2Slip"),
        *("Clutch1Phase", "Clutch2Phase", "GearShaft1", "GearShaft2"),
    ),
    "DctStatus": (
        *("DctStatusState", "EngineTorqueEstimate"),
        *("Clutch1Valid", "Clutch2Valid", "OutputValid", "GearsKnown", "PhasesKnown", "RoadLoadKnown"),
        *("Converged", "InputStale", "SpeedImplausible", "EstimateLimited"),
        *("EngineSpeedFault", "Shaft1SpeedFault", "Shaft2SpeedFault"),
        *("DrivenWheelsFault", "UndrivenWheelsFault", "EngineTorqueFault"),
        "VehicleFileImplausible",
    ),
    "DctUncertainty": (
        *("DctUncertaintyState", "Clutch1SigmaValid", "Clutch2SigmaValid", "OutputSigmaValid"),
        *("Clutch1Sigma", "Clutch2Sigma", "OutputSigma", "ClutchCorrelation"),
    ),
    "DctClutchPower": (
        *("DctClutchPowerState", "Clutch1PowerValid", "Clutch2PowerValid"),
        *("Clutch1Power", "Clutch2Power"),
    ),
    "DctClutchEnergy": (
        *("DctClutchEnergyState", "Clutch1EnergyValid", "Clutch2EnergyValid"),
        *("Clutch1Energy", "Clutch2Energy", "Clutch1Engagements", "Clutch2Engagements"),
    ),
    "DctClutchResidual": (
        *("DctClutchResidualState", "Clutch1ResidualValid", "Clutch2ResidualValid"),
        *("Clutch1Residual", "Clutch2Residual", "RecirculatedTorque", "TieUpProbability"),
    ),
    "DctClutchTemperature": (
        *("DctClutchTemperatureState", "Clutch1TemperatureValid", "Clutch2TemperatureValid"),
        *("Clutch1Temperature", "Clutch2Temperature"),
    ),
}
"""Signals of each message, in the order in which `physical_values` writes them."""

MOST_SIGNALS = max(map(len, CONTENTS.values()))

# Compiled code takes enum members as plain numbers.
_VALID1, _VALID2, _OUTPUT = int(Status.CLUTCH1_VALID), int(Status.CLUTCH2_VALID), int(Status.OUTPUT_VALID)
_GEARS, _PHASES, _LEARNED = int(Status.GEARS_KNOWN), int(Status.PHASES_KNOWN), int(Status.ROAD_LOAD_LEARNED)
_CONVERGED, _STALE = int(Status.CONVERGED), int(Status.INPUT_STALE)
_IMPLAUSIBLE, _LIMITED = int(Status.SPEED_IMPLAUSIBLE), int(Status.LIMITED)
_ENERGY1, _ENERGY2 = int(Status.ENERGY1_KNOWN), int(Status.ENERGY2_KNOWN)
_RESIDUAL1, _RESIDUAL2 = int(Status.RESIDUAL1_KNOWN), int(Status.RESIDUAL2_KNOWN)
_TEMPERATURE1, _TEMPERATURE2 = int(Status.TEMPERATURE1_KNOWN), int(Status.TEMPERATURE2_KNOWN)
_TIE_UP = int(Status.TIE_UP_KNOWN)
_ENGINE_FAULT, _SHAFT1_FAULT = int(Status.ENGINE_SPEED_FAULT), int(Status.SHAFT1_SPEED_FAULT)
_SHAFT2_FAULT, _DRIVEN_FAULT = int(Status.SHAFT2_SPEED_FAULT), int(Status.DRIVEN_WHEELS_FAULT)
_UNDRIVEN_FAULT, _TORQUE_FAULT = int(Status.UNDRIVEN_WHEELS_FAULT), int(Status.ENGINE_TORQUE_FAULT)
_FILE_IMPLAUSIBLE = int(Status.VEHICLE_FILE_IMPLAUSIBLE)
_LOCKED = int(ClutchPhase.LOCKED)


@compiled_without_allocation
def _flag(status: np.int64, bits: int) -> float:
    """Return 1 if all of some bits are set, else 0."""
    return 1.0 if status & bits == bits else 0.0


@compiled_without_allocation
def _if(flag: float, value: float) -> float:
    """Return a value that is valid if ``flag`` is 1, else NaN."""
    return np.float64(value) if flag == 1.0 else np.nan


@compiled_without_allocation
def _state(status: np.int64) -> float:
    """Return the value of the value tables Dct…State."""
    if status & _CONVERGED == 0:
        return STARTING
    return DEGRADED if status & (_STALE | _IMPLAUSIBLE | _LIMITED | _FILE_IMPLAUSIBLE) else ESTIMATING


@compiled_without_allocation
def _torques(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    out[i, 1] = valid1 = _flag(status, _VALID1)
    out[i, 2] = valid2 = _flag(status, _VALID2)
    out[i, 3] = _if(valid1, row.clutch1_torque_nm)
    out[i, 4] = _if(valid2, row.clutch2_torque_nm)
    out[i, 5] = _if(valid1 * valid2, row.clutch_torque_sum_nm)


@compiled_without_allocation
def _driveline(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    out[i, 1] = valid = _flag(status, _OUTPUT)
    out[i, 2] = learned = _flag(status, _LEARNED)
    out[i, 3] = _if(valid, row.output_torque_nm)
    out[i, 4] = _if(valid * learned, row.output_torque_adaptive_nm)
    out[i, 5] = _if(learned, row.road_load_nm)


@compiled_without_allocation
def _slips(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    phases, gears = _flag(status, _PHASES), _flag(status, _GEARS)
    out[i, 1] = valid = 1.0 - _flag(status, _STALE)
    out[i, 2] = _if(valid, row.clutch1_slip_rad_s * RPM)
    out[i, 3] = _if(valid, row.clutch2_slip_rad_s * RPM)
    out[i, 4] = _if(phases if row.phase1 <= _LOCKED else 0.0, row.phase1)
    out[i, 5] = _if(phases if row.phase2 <= _LOCKED else 0.0, row.phase2)
    out[i, 6] = _if(gears, REVERSE_CODE if row.gear1 < 0 else np.float64(row.gear1))
    out[i, 7] = _if(gears, REVERSE_CODE if row.gear2 < 0 else np.float64(row.gear2))


@compiled_without_allocation
def _status(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    out[i, 1] = _if(1.0 - _flag(status, _STALE), row.engine_torque_nm)
    out[i, 2] = _flag(status, _VALID1)
    out[i, 3] = _flag(status, _VALID2)
    out[i, 4] = _flag(status, _OUTPUT)
    out[i, 5] = _flag(status, _GEARS)
    out[i, 6] = _flag(status, _PHASES)
    out[i, 7] = _flag(status, _LEARNED)
    out[i, 8] = _flag(status, _CONVERGED)
    out[i, 9] = _flag(status, _STALE)
    out[i, 10] = _flag(status, _IMPLAUSIBLE)
    out[i, 11] = _flag(status, _LIMITED)
    out[i, 12] = _flag(status, _ENGINE_FAULT)
    out[i, 13] = _flag(status, _SHAFT1_FAULT)
    out[i, 14] = _flag(status, _SHAFT2_FAULT)
    out[i, 15] = _flag(status, _DRIVEN_FAULT)
    out[i, 16] = _flag(status, _UNDRIVEN_FAULT)
    out[i, 17] = _flag(status, _TORQUE_FAULT)
    out[i, 18] = _flag(status, _FILE_IMPLAUSIBLE)


@compiled_without_allocation
def _uncertainty(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    # a standard deviation of zero: the estimator knows none
    out[i, 1] = known1 = _flag(status, _VALID1) if row.clutch1_sigma_nm > 0.0 else 0.0
    out[i, 2] = known2 = _flag(status, _VALID2) if row.clutch2_sigma_nm > 0.0 else 0.0
    out[i, 3] = known = _flag(status, _OUTPUT) if row.output_sigma_nm > 0.0 else 0.0
    out[i, 4] = _if(known1, row.clutch1_sigma_nm)
    out[i, 5] = _if(known2, row.clutch2_sigma_nm)
    out[i, 6] = _if(known, row.output_sigma_nm)
    out[i, 7] = _if(known1 * known2, row.clutch_correlation)


@compiled_without_allocation
def _powers(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    out[i, 1] = known1 = _flag(status, _PHASES | _VALID1)
    out[i, 2] = known2 = _flag(status, _PHASES | _VALID2)
    out[i, 3] = _if(known1, row.clutch1_power_w)
    out[i, 4] = _if(known2, row.clutch2_power_w)


@compiled_without_allocation
def _energies(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    out[i, 1] = known1 = _flag(status, _ENERGY1)
    out[i, 2] = known2 = _flag(status, _ENERGY2)
    out[i, 3] = _if(known1, row.clutch1_energy_j)
    out[i, 4] = _if(known2, row.clutch2_energy_j)
    out[i, 5] = row.clutch1_engagements % ENGAGEMENT_MODULUS
    out[i, 6] = row.clutch2_engagements % ENGAGEMENT_MODULUS


@compiled_without_allocation
def _residuals(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    both = _flag(status, _VALID1 | _VALID2)
    out[i, 1] = known1 = _flag(status, _VALID1 | _RESIDUAL1)
    out[i, 2] = known2 = _flag(status, _VALID2 | _RESIDUAL2)
    out[i, 3] = _if(known1, row.clutch1_residual_nm)
    out[i, 4] = _if(known2, row.clutch2_residual_nm)
    out[i, 5] = _if(both, row.recirculated_torque_nm)
    out[i, 6] = _if(both * _flag(status, _TIE_UP), row.tie_up_probability)


@compiled_without_allocation
def _temperatures(row: Any, status: np.int64, out: NDArray[np.float64], i: int) -> None:
    out[i, 1] = known1 = _flag(status, _TEMPERATURE1)
    out[i, 2] = known2 = _flag(status, _TEMPERATURE2)
    out[i, 3] = _if(known1, row.clutch1_temperature_c)
    out[i, 4] = _if(known2, row.clutch2_temperature_c)


@compiled_without_allocation
def _write_rows(message: int, rows: NDArray[np.void], chosen: NDArray[np.int64], out: NDArray[np.float64]) -> None:
    """Write the values of one message, in the order of `CONTENTS`, for the chosen rows.

    Bounds: rows are looked at only where ``chosen`` is one; ``out`` has `MOST_SIGNALS` columns and a row for each.
    """
    for i in range(min(len(chosen), len(out))):
        if not 0 <= chosen[i] < len(rows):
            continue
        row = rows[chosen[i]]
        status = np.int64(row.status)
        out[i, 0] = _state(status)
        if message == 0:
            _torques(row, status, out, i)
        elif message == 1:
            _driveline(row, status, out, i)
        elif message == 2:
            _slips(row, status, out, i)
        elif message == 3:
            _status(row, status, out, i)
        elif message == 4:
            _uncertainty(row, status, out, i)
        elif message == 5:
            _powers(row, status, out, i)
        elif message == 6:
            _energies(row, status, out, i)
        elif message == 7:
            _residuals(row, status, out, i)
        else:
            _temperatures(row, status, out, i)


@compiled
def _write_words(
    message: int, words: NDArray[np.int64], chosen: NDArray[np.int64], out: NDArray[np.float64]
) -> None:
    _write_rows(message, words.view(ESTIMATE), chosen, out)


def estimate_words(rows: NDArray[np.void]) -> NDArray[np.int64]:
    """Return `ESTIMATE` rows as plain words: records cost more to hand over than their values to compute."""
    return np.ascontiguousarray(rows).view(np.int64)


def physical_values(message: int, words: NDArray[np.int64], chosen: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the values of a message in the units of the DBC, ``[m, MOST_SIGNALS]``; NaN where one is not valid.

    Args:
        message: its place in `CONTENTS`, which also says what the first columns are.
        words: the `estimate_words` of ``n`` estimates.
        chosen: those for which it is sent ``[m]``.
    """
    out = np.empty((len(chosen), MOST_SIGNALS))
    _write_words(message, words, chosen, out)
    return out
