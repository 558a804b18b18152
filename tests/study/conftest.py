"""A small study of the paper car: three seconds of its drive, one factor."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

SMALL: dict[str, Any] = {
    "vehicle": "paper_car",
    "drive": "paper",
    "duration_s": 3,
    "profile": "production",
    "runs": 3,
    "seed": 7,
    "vary": {"engine_torque_offset_nm": {"uniform": {"low": -20, "high": 20}}},
}


@pytest.fixture
def write_study(tmp_path: Path) -> Callable[..., Path]:
    """Write the small study with other or further keys."""

    def write(name: str = "small.yaml", **changes: Any) -> Path:
        path = tmp_path / name
        path.write_text(yaml.safe_dump(SMALL | changes, sort_keys=False))
        return path

    return write
