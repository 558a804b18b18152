import numpy as np

from dctorque_can.report.noise_lag_plot import noise_lag_figure


def test_both_clutches_noise_and_lag_with_units() -> None:
    factors = np.array([0.5, 1.0, 2.0])
    noise, lag = np.array([[1, 2], [3, 4], [9, 12.0]]), np.array([[20, 21], [10, 11], [5, 6.0]])
    axis = noise_lag_figure(factors, noise, lag, 1.5, "a car", 800.0).axes[0]
    assert axis.get_xlabel() == "Bandwidths, times the chosen ones [–]"
    assert axis.get_ylabel() == "Error of the clutch torque [N·m]"
    lines = {str(line.get_label()): line for line in axis.get_lines()}
    np.testing.assert_array_equal(lines["noise σ, clutch 2"].get_ydata(), noise[:, 1])
    np.testing.assert_array_equal(lines["lag at 800 N·m/s, clutch 1"].get_ydata(), lag[:, 0])
    texts = [text.get_text() for text in axis.texts]
    assert texts == ["chosen", "too fast for the step"]
