"""The types of the equations' arguments: one number, or an array with one number for each instant."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Values: TypeAlias = float | NDArray[np.float64]
"""A number or float64 of any shape; arguments of one call are broadcast against each other."""

Phases: TypeAlias = int | NDArray[np.integer[Any]]
"""A `ClutchPhase` or an array of them."""
