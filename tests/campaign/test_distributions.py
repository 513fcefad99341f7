"""Distributions against scipy's, and through the shared statistical harness."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats

from campaign.distributions import Variable
from campaign.sampling import draw
from tests.campaign.statistics import check_sample

C60 = {"distribution": "truncated_normal", "mean": 0.07, "std": 0.0175, "lower": 0.01, "upper": 0.13}

CONTINUOUS = [
    C60,
    {"distribution": "truncated_normal", "mean": 0.0, "std": 1.0, "lower": 3.0, "upper": 9.0},
    {"distribution": "truncated_normal", "mean": 0.0, "std": 1.0, "lower": -9.0, "upper": -3.0},
    {"distribution": "normal", "mean": -2.0, "std": 3.0},
    {"distribution": "uniform", "lower": 2.0, "upper": 5.0},
    {"distribution": "triangular", "lower": 0.0, "mode": 1.0, "upper": 4.0},
    {"distribution": "triangular", "lower": 0.0, "mode": 0.0, "upper": 1.0},
    {"distribution": "triangular", "lower": 0.0, "mode": 1.0, "upper": 1.0},
]


def make(entry):
    return TypeAdapter(Variable).validate_python(entry)


def name(entry):
    return "-".join(map(str, entry.values()))


@pytest.mark.parametrize("entry", CONTINUOUS, ids=name)
def test_quantiles_are_scipys(entry):
    """The quantile functions, written here for bits that do not depend on the company, agree with scipy's."""
    variable, u = make(entry), np.array([1e-9, 0.01, 0.3, 0.5, 0.9, 1.0 - 1e-9])
    assert variable.ppf(u) == pytest.approx(variable.frozen().ppf(u), rel=1e-12, abs=1e-14)


def test_truncated_normal_is_scipys():
    """The parameters mean what they say: mean and deviation before the cut."""
    oracle = stats.truncnorm((0.01 - 0.07) / 0.0175, (0.13 - 0.07) / 0.0175, 0.07, 0.0175)
    assert make(C60).moments() == pytest.approx((oracle.mean(), oracle.std()))
    assert make(C60).ends() == (0.01, 0.13)


@pytest.mark.parametrize("entry", CONTINUOUS, ids=name)
def test_samples_follow_the_distribution(entry):
    """Bounds, moments and shape of 20,000 draws."""
    variable = make(entry)
    check_sample(draw({"x": variable}, seed=11, first=0, count=20_000)["x"], variable)


@pytest.mark.parametrize("entry", CONTINUOUS, ids=name)
def test_density_integrates_to_one(entry):
    """The curve that is drawn is a density: over the ends it holds all but the 1e-6 tails."""
    x, y = np.array(make(entry).density_points(20_001)).T
    assert np.trapezoid(y, x) == pytest.approx(1.0, abs=1e-4)


def test_unbounded_ends_are_quantiles():
    """A normal variable is tried on the mechanism where one in a million lies beyond."""
    low, high = make({"distribution": "normal", "mean": 1.0, "std": 0.1}).ends()
    assert (low, high) == pytest.approx((1.0 - 0.47534, 1.0 + 0.47534), abs=1e-5)


def test_constant():
    """A constant is drawn as itself and has no density."""
    variable = make({"distribution": "constant", "value": 3.0})
    assert draw({"x": variable}, 1, 0, 3)["x"].tolist() == [3.0, 3.0, 3.0]
    assert (variable.moments(), variable.ends(), variable.density_points()) == ((3.0, 0.0), (3.0, 3.0), ())
    assert variable.cdf(np.array([2.9, 3.0])).tolist() == [0.0, 1.0]
