from pathlib import Path

import numpy as np
import pytest

from dctorque_can.errors import DctorqueError
from dctorque_can.pipeline.estimates import ESTIMATE
from dctorque_can.report.drive_plot import drive_figure
from dctorque_can.report.plot_file import save_figure
from dctorque_can.report.sensitivity_plot import SensitivityPanel, sensitivity_figure


@pytest.fixture
def estimates() -> np.ndarray:
    rows = np.zeros(100, ESTIMATE)
    rows["t_us"] = 1_704_067_200_000_000 + 10_000 * np.arange(100)
    rows["clutch1_torque_nm"] = np.arange(100)
    return rows


def test_every_panel_has_a_name_and_a_unit(estimates: np.ndarray) -> None:
    figure = drive_figure(estimates, estimates, "a drive")
    labels = [axis.get_ylabel() for axis in figure.axes]
    for name in ("Speed [rpm]", "Clutch 1 torque [N·m]", "Clutch 2 torque [N·m]", "Output torque [N·m]"):
        assert name in labels
    assert "Time [s]" in [axis.get_xlabel() for axis in figure.axes]
    clutch1 = figure.axes[labels.index("Clutch 1 torque [N·m]")]
    true, estimated = clutch1.get_lines()
    np.testing.assert_allclose(estimated.get_xdata(), 0.01 * np.arange(100))
    np.testing.assert_array_equal(true.get_ydata(), np.arange(100))


def test_a_band_is_drawn_where_the_estimator_states_one(estimates: np.ndarray) -> None:
    """1.96 σ on both sides of the estimate, however wide it is at the start, within the scale of the torques."""
    estimates["clutch1_sigma_nm"] = np.nan  # as of the 2014 observer
    plain = drive_figure(estimates, estimates, "a drive").axes[1]
    assert not plain.collections
    assert "95 % band" not in [text.get_text() for text in plain.get_legend().get_texts()]
    estimates["clutch1_sigma_nm"] = 2.0
    estimates["clutch1_sigma_nm"][0] = 1e4
    axis = drive_figure(estimates, estimates, "a drive").axes[1]
    (band,) = axis.collections
    (outline,) = band.get_paths()
    at_half_a_second = outline.vertices[np.isclose(outline.vertices[:, 0], 0.5), 1]
    assert sorted(at_half_a_second) == pytest.approx([50 - 3.92, 50 + 3.92])
    assert axis.get_ylim() == plain.get_ylim()
    assert "95 % band" in [text.get_text() for text in axis.get_legend().get_texts()]


def test_a_picture_is_written_without_truth_too(estimates: np.ndarray, tmp_path: Path) -> None:
    save_figure(drive_figure(estimates, None, "a drive"), tmp_path / "drive.png")
    assert (tmp_path / "drive.png").read_bytes().startswith(b"\x89PNG")


def test_failures_are_clear(estimates: np.ndarray) -> None:
    with pytest.raises(DctorqueError, match="no estimates"):
        drive_figure(estimates[:0], None, "")
    with pytest.raises(DctorqueError, match=r"/nowhere/x\.png: the plot cannot be written"):
        save_figure(drive_figure(estimates, None, ""), Path("/nowhere/x.png"))


def test_the_bars_of_a_ranking_are_named_measured_and_marked(tmp_path: Path) -> None:
    change = np.arange(12.0, 0.0, -1.0)
    panel = SensitivityPanel(
        title="Clutch 1",
        labels=[f"factor {i}" for i in range(12)],
        change=change,
        low=0.8 * change,
        high=1.2 * change,
        significant=change > 6,
        shapes=["∪"] * 12,
    )
    figure = sensitivity_figure([panel, panel, panel], "a study")
    assert figure.get_size_inches()[0] * figure.dpi == 900
    for axis in figure.axes:
        assert axis.get_xlabel().endswith("[N·m]")
        assert [bar.get_width() for bar in axis.patches] == list(change[:10])
        assert [label.get_text() for label in axis.get_yticklabels()] == panel.labels[:10]
        assert len({bar.get_facecolor() for bar in axis.patches}) == 2
        assert "2 more factors below 3 N·m" in [text.get_text() for text in axis.texts]
        assert "12 ∪" in [text.get_text() for text in axis.texts]
    save_figure(figure, tmp_path / "sensitivity.png")
    with pytest.raises(DctorqueError, match="no factors"):
        sensitivity_figure([], "")
