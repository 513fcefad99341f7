"""Changed distributions: ratios of densities against known laws, and what samples are worth, against closed forms."""

from math import inf

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats

from campaign.inputs.distributions import Variable
from campaign.inputs.sampling import draw
from clearcap.questions.whatif import change_distributions, changed_variables, samples_worth
from reporting.tolerance.reweighting import Change, weights

_DISTRIBUTION = TypeAdapter(Variable)


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


def made(**table):
    return _DISTRIBUTION.validate_python(table)


def normal(std, mean=0.0):
    return made(distribution="normal", mean=mean, std=std)


@pytest.mark.parametrize("factor", [1.1, 1.2, 1.3])
def test_a_wider_normal_distribution(factor):
    """E_old[w^2 (z^2 - 1)^2] is an integral of Gauss: with v = 1 / (2 - f^2), sqrt(v) (3 v^2 - 2 v + 1) / f."""
    v = 1.0 / (2.0 - factor**2)
    cost = np.sqrt(v) * (3 * v**2 - 2 * v + 1) / factor
    assert samples_worth([(normal(1.0), normal(factor))]) == pytest.approx(
        min(2.0 / cost, 1.0), rel=0.01
    )  # its grid ends at 1e-13


def test_where_the_variance_is_infinite_samples_are_worth_nothing():
    """From sqrt(2) times the sigma on, no number of samples determines the new sigma."""
    assert samples_worth([(normal(1.0), normal(1.5))]) < 1e-3
    cut = [made(distribution="truncated_normal", mean=0.0, std=s, lower=-3.0, upper=3.0) for s in (1.0, 1.5)]
    assert samples_worth([tuple(cut)]) > 0.08  # its bounds keep the weights bounded


def test_a_narrower_one_and_none():
    """No sample is worth more than a new run; two changed variables cost more than one."""
    assert samples_worth([]) == 1.0
    assert samples_worth([(normal(1.0), normal(0.7))]) == 1.0
    one, two = samples_worth([(normal(1.0), normal(1.2))]), samples_worth([(normal(1.0), normal(1.2))] * 2)
    assert two < one
    assert samples_worth([(made(distribution="poisson", rate=3.0), made(distribution="poisson", rate=3.0))]) == 1.0


def test_weights_are_refused_by_the_distributions_alone():
    """Samples whose weights look harmless are refused where the distributions say that their tail was missed."""
    ratio = np.zeros(1_000)
    assert not weights(Change(ratio)).refusal
    assert "worth 20 new runs; 30 are needed" in weights(Change(ratio, worth=0.02)).refusal
