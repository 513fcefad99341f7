"""A response against its strongest inputs: the right ones, the right slope, and a bounded number of points."""

from dataclasses import replace

import numpy as np
import pytest

from reporting.sensitivity.scatter import EXTREMES, POINTS, scatters
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


@pytest.mark.parametrize("n", [20, 400, 5_000])
def test_the_two_strongest_inputs_are_shown(n) -> None:
    """FC-1 rises with J1 by 0.8 * 0.478 N a sigma of 0.0175 mm; the points are samples, extremes among them."""
    table, spec = c60_table(n), c60_spec(n)
    response = analysis_of(table, replace(spec, responses=spec.responses[:1])).responses[0]
    first, second = response.scatters
    assert first.variable == "J1"
    assert [s.variable for s in (first, second)] == [i.variable for i in response.sensitivity.ranked[:2]]
    assert first.n == n
    assert min(n, POINTS) <= len(first.x) <= min(n, POINTS + 2 * EXTREMES)
    x, y = table["J1"].to_numpy(), table["FC-1"].to_numpy()
    assert set(zip(first.x, first.y, strict=True)) <= set(zip(x, y, strict=True))
    assert (min(first.y), max(first.y)) == (y.min(), y.max())
    assert first.slope == pytest.approx(np.polyfit(x, y, 1)[0], rel=1e-6)
    assert (len(first.mean_x) == 12) == (n >= 60)
    if first.mean_x:
        assert np.all(np.diff(first.mean_x) > 0)
        assert np.average(first.mean_y) == pytest.approx(y.mean(), abs=1e-2)


def test_a_response_without_inputs_has_none() -> None:
    """Nothing varies, or nothing is known of what varies."""
    spec = replace(c60_spec(50), variables=())
    assert all(not r.scatters for r in analysis_of(c60_table(50), spec).responses)


def test_the_extremes_of_many_samples_are_drawn() -> None:
    """Of all of them, although the others are a few random ones, and the slope is that of random ones."""
    n = 250_000
    x, noise = np.random.default_rng(3).normal(size=(2, n))
    inputs, y = {"a": x, "flat": np.full(n, 2.0)}, 3.0 * x + noise
    found = scatters(None, inputs, y)
    (of_a,) = found
    ordered = np.sort(y)
    assert {*ordered[:EXTREMES], *ordered[-EXTREMES:]} <= set(of_a.y)
    assert len(of_a.y) <= POINTS + 2 * EXTREMES
    assert of_a.n == n
    assert of_a.slope == pytest.approx(3.0, abs=0.02)


def test_samples_without_an_input_are_left_out() -> None:
    x = np.random.default_rng(4).normal(size=300)
    y, known = 2.0 * x, np.where(np.arange(300) < 30, np.nan, x)
    (found,) = scatters(None, {"a": known}, y)
    assert found.n == 270
    assert set(found.x) == set(x[30:])
