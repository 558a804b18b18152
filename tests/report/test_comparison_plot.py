import pytest

from dctorque_can.analysis.comparison import Comparison, Figures, TorqueFigures
from dctorque_can.analysis.consistency import LEVELS, Bands, Nees
from dctorque_can.analysis.errors import TORQUES
from dctorque_can.errors import DctorqueError
from dctorque_can.report.comparison_plot import comparison_figure


def figures(states_deviations: bool = False) -> Figures:
    bands = Bands(100, (0.4, 0.8, 0.9), 3.0) if states_deviations else None
    torque = TorqueFigures(5.0, (5.0,), 1.0, 20.0, None, bands, 0.0)
    nees = Nees(100, 2.0, 50.0, 1.5, 2.5, 6.0) if states_deviations else None
    return Figures(100, dict.fromkeys(TORQUES, torque), nees)


def comparisons() -> dict[str, Comparison]:
    return {
        "plain": Comparison(figures(), figures()),
        "honest": Comparison(figures(True), figures(True)),
        "early": Comparison(figures(), None),
    }


def test_the_picture_shows_every_variant() -> None:
    figure = comparison_figure(comparisons(), "a title")
    figure.canvas.draw()
    *bars, coverage = figure.axes
    assert [len(axis.patches) for axis in bars] == [5, 5, 5]  # one has no shifts
    assert [text.get_text() for text in bars[0].get_yticklabels()] == ["plain", "honest", "early"]
    labels = [text.get_text() for text in coverage.get_yticklabels()]
    assert labels == ["Clutch 1, honest", "Clutch 2, honest", "Output shaft, honest"]
    assert len(coverage.lines) == len(LEVELS) * (1 + 2 * 3)
    assert figure.get_figwidth() * figure.dpi == 900


def test_without_stated_deviations_there_is_no_coverage_to_show() -> None:
    assert len(comparison_figure({"plain": comparisons()["plain"]}, "").axes) == 3
    with pytest.raises(DctorqueError, match="nothing to draw"):
        comparison_figure({}, "")
