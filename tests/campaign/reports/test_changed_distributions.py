"""Changed distributions: ratios of densities against known laws."""

from math import inf

import numpy as np
import pytest
from scipy import stats

from campaign.inputs.sampling import draw
from campaign.reports.changed_distributions import change_distributions
from campaign.reports.variable_settings import changed_variables


def cut(mean: float, std: float) -> stats.rv_continuous:
    """Return the truncated normal distribution of J1."""
    return stats.truncnorm((0.01 - mean) / std, (0.13 - mean) / std, mean, std)


def test_the_ratio_is_that_of_the_densities(campaign):
    """Against scipy's truncated normal, and a uniform variable cut to half its width."""
    spec, columns = campaign.spec, draw(campaign.spec, 0, 25)
    new = changed_variables(spec, ["J1.std=0.01", "J1.mean=0.072", "preload.upper=0.95"]).variables
    found = change_distributions(spec, new, columns)
    of_j1 = cut(0.072, 0.01).logpdf(columns["J1"]) - cut(0.07, 0.0175).logpdf(columns["J1"])
    of_preload = np.where(columns["preload"] <= 0.95, np.log(2.0), -inf)
    np.testing.assert_allclose(found.log_ratio, of_j1 + of_preload, rtol=1e-9)
    assert found.outside == 0.0
    assert change_distributions(
        spec, changed_variables(spec, ["preload.lower=0.8"]).variables, columns
    ).outside == pytest.approx(0.5)


def test_correlated_variables_keep_their_copula(campaign):
    """Weighted samples have the moments of samples drawn anew, products too, within 5 standard errors."""
    variables = {**campaign.spec.variables, "J2": campaign.spec.variables["J1"]}
    asked = {"variables": variables, "correlations": (("J1", "J2", 0.7),), "samples": 40_000}
    spec = campaign.spec.model_copy(update=asked)
    new = changed_variables(spec, ["J1.std=0.013", "J2.mean=0.073"]).variables
    old, fresh = draw(spec, 0, 40_000), draw(spec.model_copy(update={"variables": {**variables, **new}}), 0, 40_000)
    weight = np.exp(change_distributions(spec, new, old).log_ratio)
    for of in (lambda x: x["J1"], lambda x: x["J2"], lambda x: (x["J1"] - 0.07) * (x["J2"] - 0.07)):
        a, b = of(old), of(fresh)
        mean = np.sum(weight * a) / weight.sum()
        error = np.hypot(np.sqrt(np.sum((weight * (a - mean)) ** 2)) / weight.sum(), b.std() / 200)
        assert abs(mean - b.mean()) < 5 * error
