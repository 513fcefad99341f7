"""The omnibus test of skewness and kurtosis is scipy's."""

import numpy as np
import pytest
from scipy import stats

from reporting.capability.moments import normal_moments_p
from tests.each import each


@each("n", [20, 50, 500, 5000])
@each("draw", ["normal", "uniform", "exponential", "laplace"])
def test_p_is_scipys(draw: str, n: int) -> None:
    x = getattr(np.random.default_rng(n), draw)(size=n)
    assert normal_moments_p(x - x.mean(), n) == pytest.approx(stats.normaltest(x).pvalue, rel=1e-9)
