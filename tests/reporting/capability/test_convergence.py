"""The index over the first samples, and whether both halves tell the same."""

import numpy as np
import pytest

from reporting import capability
from reporting.capability import row_order
from reporting.capability.row_order import DRIFT_BAR, convergence, drift


@pytest.mark.parametrize("offset", [0.0, 1e6, -3e8])
def test_each_point_is_the_capability_of_its_samples(offset) -> None:
    x = np.random.default_rng(4).normal(offset, 1.0, 500)
    found = convergence(x, offset - 3, offset + 5, 0.95)
    assert found.n[-1] == 500
    for n, value, low, high in zip(found.n, found.value, found.low, found.high, strict=True):
        c = capability(x[:n], offset - 3, offset + 5)
        assert value == pytest.approx(c.cpk, rel=1e-6)
        assert (low, high) == pytest.approx(c.cpk_interval, rel=1e-6)


def test_without_limits_it_is_the_mean() -> None:
    x = np.random.default_rng(5).normal(3.0, 1.0, 200)
    found = convergence(x, None, None, 0.95)
    assert (found.index, found.value[-1]) == ("mean", pytest.approx(x.mean()))


@pytest.mark.parametrize("draw", ["normal", "exponential"])
def test_the_drift_of_nothing_is_that_of_chance(draw) -> None:
    """Beyond 1.96 standard errors in one of twenty series, whatever the distribution: 600 series, +-4 errors."""
    rng = np.random.default_rng(6)
    drifts = [drift(getattr(rng, draw)(size=1000), -4, 6, None) for _ in range(600)]
    share = np.mean(np.abs(drifts) > 1.96)
    assert abs(share - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 600)


@pytest.mark.parametrize(("shift", "stretch"), [(0.5, 1.0), (0.0, 1.4)])
def test_a_change_half_way_is_seen(shift, stretch) -> None:
    x = np.random.default_rng(7).normal(size=4000)
    x[2000:] = stretch * x[2000:] + shift
    assert abs(convergence(x, -4, 6, 0.95).drift) > DRIFT_BAR


@pytest.mark.parametrize("x", [np.zeros(0), np.ones(9), np.full(100, 3.7)])
def test_nothing_to_run_is_none(x) -> None:
    assert convergence(x, 0.0, 1.0, 0.95) is None


@pytest.mark.parametrize("limits", [(-3.0, 5.0), (None, None)])
@pytest.mark.parametrize("draw", ["normal", "exponential", "uniform"])
def test_points_of_many_samples_come_from_sums_over_all(monkeypatch, draw, limits) -> None:
    """They are those of the samples themselves, whatever the shape and however far from zero."""
    x = 1e5 + getattr(np.random.default_rng(8), draw)(size=3000)
    ends = [None if end is None else end + 1e5 for end in limits]
    expected = convergence(x, *ends, 0.95)
    monkeypatch.setattr(row_order, "MOST_ROWS", 200)
    found = convergence(x, *ends, 0.95)
    assert found.n == expected.n
    for name in ("value", "low", "high"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-7)


def test_many_samples_that_begin_with_equal_ones_have_the_same_points(monkeypatch) -> None:
    x = np.concatenate([np.full(300, 1.0), np.random.default_rng(9).normal(1.0, 1.0, 700)])
    expected = convergence(x, -3.0, 5.0, 0.95)
    monkeypatch.setattr(row_order, "MOST_ROWS", 200)
    assert convergence(x, -3.0, 5.0, 0.95) == expected
