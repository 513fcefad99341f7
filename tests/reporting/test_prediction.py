"""Measured against simulated: what is certain, what is seen, and how often the truth lies within what is said."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from reporting.comparison import validation
from reporting.errors import ReportError
from reporting.samples import read_samples
from reporting.spec import Design, ReportSpec, ResponseSpec


def of(**values):
    """Return samples of responses, and their spec."""
    n = len(next(iter(values.values())))
    fixed = {"sample": np.arange(n), "status": ["ok"] * n, "message": [""] * n, "settled": np.ones(n, bool)}
    zeros = {name: np.zeros(n) for name in ("max_residual", "max_penetration")}
    responses = tuple(ResponseSpec(name, "", "mm", None, None, None, "") for name in values)
    spec = ReportSpec("", "runs", {}, responses, (), {}, n)
    return read_samples(pa.table({**fixed, **zeros, **values}), spec), spec


def test_the_numbers_are_those_of_scipy():
    rng = np.random.default_rng(1)
    x, y = rng.normal(1.1, 2.0, 150), rng.normal(1.0, 1.9, 3000)
    found = validation(*of(d=x), *of(d=y)).predictions[0]
    interval = stats.ttest_ind(x, y, equal_var=False).confidence_interval(0.95)
    assert found.comparison.mean_interval == pytest.approx(tuple(interval))
    assert found.mean_within == pytest.approx(max(abs(interval.low), abs(interval.high)))
    outside = np.count_nonzero((x < np.quantile(y, 0.005)) | (x > np.quantile(y, 0.995)))
    assert found.beyond == outside / 150
    assert found.beyond_interval == pytest.approx(tuple(stats.binomtest(outside, 150).proportion_ci()), abs=1e-6)
    assert found.quantiles[3] == (0.5, pytest.approx(np.median(x)), pytest.approx(np.median(y)))
    assert "no difference is seen" in found.verdict


def test_what_differs_is_said():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 2000))
    simulated = of(d=a, e=0.9 * a + 0.4 * b)
    x, y = rng.normal(size=(2, 200))
    found = validation(*of(d=2 * x + 1, e=y), *simulated)
    assert "the mean is above the predicted one" in found.predictions[0].verdict
    assert "sigma is" in found.predictions[0].verdict
    assert "tails" in found.predictions[0].verdict
    assert found.correlations[0].difference_interval[1] < 0
    few = validation(*of(d=x[:5]), *simulated).predictions[0]
    assert "too few" in few.verdict
    assert validation(*of(d=x), *of(d=a[:300])).predictions[0].beyond_interval is None


def test_a_sigma_too_small_is_as_far_off_as_one_too_large():
    """Half or twice the predicted one: within a factor of more than two, either way."""
    y = np.random.default_rng(4).normal(size=1000)
    factors = [validation(*of(d=k * y[:200]), *of(d=y)).predictions[0].std_within for k in (0.5, 2.0)]
    assert min(factors) > 2.0
    assert max(factors) < 2.6


def test_samples_that_are_no_production_predict_nothing():
    x = of(d=np.arange(20.0))
    corners = replace(x[1], sampler="worst_case", design=Design(False, "corners"))
    with pytest.raises(ReportError, match="production"):
        validation(*x, x[0], corners)


@pytest.mark.slow
@pytest.mark.parametrize("parts", [30, 200])
def test_the_truth_lies_within_what_is_said(parts):
    """A model that is off by 0.2 sigma and a factor of 1.1, skew values: 300 comparisons with 1,000 samples."""
    rng, mean, std = np.random.default_rng(3), 0, 0
    shape = stats.lognorm(0.3)
    for _ in range(300):
        x = (shape.rvs(parts, random_state=rng) - shape.mean()) / shape.std() * 1.1 + 0.2
        y = (shape.rvs(1000, random_state=rng) - shape.mean()) / shape.std()
        found = validation(*of(d=x), *of(d=y)).predictions[0]
        low, high = found.comparison.mean_interval
        mean += low <= 0.2 <= high and found.mean_within >= 0.2
        low, high = found.comparison.std_ratio_interval
        std += low <= 1.1 <= high and found.std_within >= 1.1
    assert min(mean, std) >= 269  # fewer than 269 of 300 at 93 %: 0.01
