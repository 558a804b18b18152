"""Truth in logs, also in those of versions whose simulation knew less."""

from pathlib import Path

import numpy as np

from dctorque_can.logs.mcap.table import Table
from dctorque_can.logs.mcap.writer import McapLog
from dctorque_can.offline.truth_log import TRUTHS, read_truth, write_truth
from dctorque_can.simulation.truth import TRUTH


def test_truth_of_an_older_version_is_read(tmp_path: Path) -> None:
    """What it did not know is 0."""
    rows = np.zeros(5, TRUTH)
    rows["t_us"] = 1000 * np.arange(5)
    rows["output_torque_nm"] = 3.0
    rows["wheel_difference_rad_s"] = 2.0
    old = np.dtype(
        [(name, TRUTH[name]) for name in TRUTH.names or () if name != "wheel_difference_rad_s"], align=True
    )
    known = np.zeros(5, old)
    for name in old.names or ():
        known[name] = rows[name]
    with McapLog(tmp_path / "old.mcap") as log:
        log.write_table(Table(TRUTHS.topic, TRUTHS.type_name, old), known)
    with McapLog(tmp_path / "new.mcap") as log:
        write_truth(log, rows)
    np.testing.assert_array_equal(read_truth(tmp_path / "new.mcap"), rows)
    rows["wheel_difference_rad_s"] = 0.0
    np.testing.assert_array_equal(read_truth(tmp_path / "old.mcap"), rows)
