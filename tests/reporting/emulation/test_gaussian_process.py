"""Emulators against functions that are known, numpy's linear algebra, and refits that leave a row out."""

import numpy as np
import pytest

from reporting import format_numbers
from reporting.emulation import gaussian_process
from reporting.emulation.gaussian_process import WIDE, fit_emulator
from reporting.errors import ReportError


def drawn(n, d, seed=1):
    return np.random.default_rng(seed).standard_normal((n, d))


def bent(x):
    """Return a smooth function of three variables."""
    return 3.0 + 2.0 * x[:, 0] + np.sin(1.5 * x[:, 1]) + 0.3 * x[:, 0] * x[:, 2]


def test_smooth_functions_are_predicted_within_their_intervals():
    """Units of variables and response do not matter; new points lie within 95 % intervals about that often."""
    x, new = drawn(80, 3), drawn(500, 3, 2)
    emulator = fit_emulator(x * [0.01, 1.0, 1e3] + [5.0, 0.0, -7.0], 1e-4 * bent(x))
    position = new * [0.01, 1.0, 1e3] + [5.0, 0.0, -7.0]
    mean, covariance = emulator.predict(position[:, None, :])
    error = mean[:, 0] - 1e-4 * bent(new)
    inside = np.abs(error) < 1.96 * np.sqrt(covariance[:, 0, 0] + emulator.scatter**2)
    assert emulator.quality.q2 > 0.99
    assert emulator.quality.refusal == ""
    assert inside.mean() > 0.9
    assert mean[:, 0] == pytest.approx(emulator.mean(position))


def test_predictions_are_those_of_the_textbook():
    """Mean and joint covariance equal k' K^-1 y and k** - k' K^-1 k, by numpy's inverse."""
    x = drawn(30, 2)
    emulator = fit_emulator(x, np.sin(2 * x[:, 0]) + x[:, 1] ** 2)

    def kernel(a, b):
        r = np.sqrt(5 * np.sum(((a[:, None] - b[None]) / emulator.length) ** 2, axis=-1))
        return WIDE * (1 + a @ b.T) + emulator.smooth * (1 + r + r**2 / 3) * np.exp(-r)

    z, rows = emulator.standard(drawn(4, 2, 5)), emulator.x
    inverse = np.linalg.inv(kernel(rows, rows) + emulator.noise * np.eye(30))
    v = (np.sin(2 * x[:, 0]) + x[:, 1] ** 2 - emulator.level) / emulator.unit
    mean, covariance = emulator.predict(drawn(4, 2, 5))
    assert mean == pytest.approx(emulator.level + emulator.unit * kernel(z, rows) @ inverse @ v, rel=1e-4)
    expected = kernel(z, z) - kernel(z, rows) @ inverse @ kernel(rows, z)
    assert covariance == pytest.approx((emulator.inflation * emulator.unit) ** 2 * expected, abs=1e-5)


def test_gradients_are_those_of_differences():
    x, at = drawn(40, 3), drawn(6, 3, 3)
    emulator = fit_emulator(x, bent(x))
    for j, slope in enumerate(emulator.gradient(at).T):
        step = 1e-5 * np.eye(3)[j]
        assert slope == pytest.approx((emulator.mean(at + step) - emulator.mean(at - step)) / 2e-5, abs=1e-4)


def test_cross_validation_leaves_each_row_out():
    """The closed form equals what the other rows predict, with the same lengths."""
    x = drawn(25, 2)
    y = np.sin(2 * x[:, 0]) + 0.3 * drawn(25, 1, 9)[:, 0]
    emulator = fit_emulator(x, y)
    v, kernel = (y - emulator.level) / emulator.unit, (emulator.length, emulator.smooth, emulator.noise)
    errors = []
    for i in range(25):
        others = np.arange(25) != i
        weights = gaussian_process._conditioned(emulator.x[others], v[others], kernel)[1]
        errors.append(v[i] - gaussian_process._covariance(emulator.x[[i]], emulator.x[others], *kernel[:2]) @ weights)
    assert emulator.quality.error == pytest.approx(emulator.unit * np.sqrt(np.mean(np.square(errors))), rel=1e-5)


def test_scatter_is_no_function():
    """Rows that scatter are refused, and more of them are no remedy; a rough function asks for more."""
    x, rng = drawn(120, 2), np.random.default_rng(4)
    noisy = fit_emulator(x, x[:, 0] + 2.0 * rng.standard_normal(120))
    assert "more rows would not help" in noisy.quality.refusal
    few = fit_emulator(x[:40], np.sin(3 * x[:40, 0]) * np.cos(2 * x[:40, 1]))
    assert few.quality.needed > 40
    assert f"compute about {format_numbers.grouped(few.quality.needed - 40)} more" in few.quality.refusal


def test_rows_beyond_those_fitted_are_predicted_too(monkeypatch):
    monkeypatch.setattr(gaussian_process, "FITTED_ROWS", 60)
    x = drawn(100, 3)
    quality = fit_emulator(x, bent(x)).quality
    assert (quality.rows, quality.checked) == (60, 100)


def test_too_little_is_refused():
    x = drawn(30, 2)
    with pytest.raises(ReportError, match="compute more"):
        fit_emulator(x[:10], x[:10, 0])
    with pytest.raises(ReportError, match="all values are equal"):
        fit_emulator(x, np.full(30, 7.0))
