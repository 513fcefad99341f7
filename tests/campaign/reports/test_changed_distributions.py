"""Changed distributions: ratios of densities against known laws, and settings that are refused."""

from math import inf

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats

from campaign.errors import SpecError
from campaign.inputs.distributions import Variable
from campaign.inputs.sampling import draw
from campaign.reports.changed_distributions import change_distributions, changed_variables, scale_spread, with_spread


def cut(mean: float, std: float) -> stats.rv_continuous:
    """Return the truncated normal distribution of J1."""
    return stats.truncnorm((0.01 - mean) / std, (0.13 - mean) / std, mean, std)


def test_the_ratio_is_that_of_the_densities(campaign):
    """Against scipy's truncated normal, and a uniform variable cut to half its width."""
    spec, columns = campaign.spec, draw(campaign.spec, 0, 25)
    new = changed_variables(spec, ["J1.std=0.01", "J1.mean=0.072", "preload.upper=0.95"])
    found = change_distributions(spec, new, columns)
    of_j1 = cut(0.072, 0.01).logpdf(columns["J1"]) - cut(0.07, 0.0175).logpdf(columns["J1"])
    of_preload = np.where(columns["preload"] <= 0.95, np.log(2.0), -inf)
    np.testing.assert_allclose(found.log_ratio, of_j1 + of_preload, rtol=1e-9)
    assert found.outside == 0.0
    assert change_distributions(spec, changed_variables(spec, ["preload.lower=0.8"]), columns).outside == pytest.approx(
        0.5
    )


def test_widening_follows_the_law_and_says_how_far_it_came(campaign):
    """A factor is of the spread inside the bounds, which allow no more than that of a uniform law on them."""
    columns = draw(campaign.spec, 0, 25)
    now = cut(0.07, 0.0175).std()
    for factor in (0.6, 1.5, 1.9):
        found = scale_spread(campaign.spec, {"J1": factor}, columns)
        assert found.spread == factor
        law = with_spread(campaign.spec.variables["J1"], factor)
        assert cut(0.07, law.std).std() == pytest.approx(factor * now, rel=1e-5)
        ranks = cut(0.07, 0.0175).cdf(columns["J1"])
        np.testing.assert_allclose(found.moved, cut(0.07, law.std).ppf(ranks), rtol=1e-6)
    most = scale_spread(campaign.spec, {"J1": 4.0}, columns)
    assert most.spread == pytest.approx(0.12 / np.sqrt(12) / now, rel=1e-5)
    assert np.ptp(most.log_ratio - cut(0.07, 0.0175).logpdf(columns["J1"]) * -1) < 1e-5
    stretched = scale_spread(campaign.spec, {"preload": 1.25}, columns)
    np.testing.assert_allclose(stretched.log_ratio, np.log(0.8), rtol=1e-9)
    np.testing.assert_allclose(stretched.moved, 0.95 + 1.25 * (columns["preload"] - 0.95), rtol=1e-12)
    assert stretched.outside == pytest.approx(0.2)
    both = scale_spread(campaign.spec, {"J1": 1.5, "preload": 0.5}, columns)
    inside = np.abs(columns["preload"] - 0.95) <= 0.025
    alone = scale_spread(campaign.spec, {"J1": 1.5}, columns)
    np.testing.assert_allclose(both.log_ratio[inside], alone.log_ratio[inside] + np.log(2), rtol=1e-9)
    assert np.all(both.log_ratio[~inside] == -inf)


def test_a_spread_may_be_limited_by_parameters_and_follows_production_batches(campaign):
    """A beta distribution has no more than sqrt((mean - lower)(upper - mean)); shifts of batches grow with the rest."""
    table = {"distribution": "beta", "lower": 0.0, "upper": 1.0, "mean": 0.5, "std": 0.2}
    beta = campaign.spec.model_copy(update={"variables": {"b": _variable(table)}})
    columns = {"b": np.linspace(0.05, 0.95, 25)}
    assert scale_spread(beta, {"b": 1.5}, columns).spread == 1.5
    assert scale_spread(beta, {"b": 4.0}, columns).spread == pytest.approx(2.5, rel=1e-3)
    shifting = _variable({"distribution": "normal", "mean": 1.0, "std": 0.1, "batch": {"size": 5, "std": 0.1}})
    law = with_spread(shifting, 1.7)
    assert (law.std, law.batch.std) == (pytest.approx(0.17), pytest.approx(0.17))


def _variable(table):
    return TypeAdapter(Variable).validate_python(table)


def test_correlated_variables_keep_their_copula(campaign):
    """Weighted samples have the moments of samples drawn anew, products too, within 5 standard errors."""
    variables = {**campaign.spec.variables, "J2": campaign.spec.variables["J1"]}
    asked = {"variables": variables, "correlations": (("J1", "J2", 0.7),), "samples": 40_000}
    spec = campaign.spec.model_copy(update=asked)
    new = changed_variables(spec, ["J1.std=0.013", "J2.mean=0.073"])
    old, fresh = draw(spec, 0, 40_000), draw(spec.model_copy(update={"variables": {**variables, **new}}), 0, 40_000)
    weight = np.exp(change_distributions(spec, new, old).log_ratio)
    for of in (lambda x: x["J1"], lambda x: x["J2"], lambda x: (x["J1"] - 0.07) * (x["J2"] - 0.07)):
        a, b = of(old), of(fresh)
        mean = np.sum(weight * a) / weight.sum()
        error = np.hypot(np.sqrt(np.sum((weight * (a - mean)) ** 2)) / weight.sum(), b.std() / 200)
        assert abs(mean - b.mean()) < 5 * error


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("J9.std=0.01", "VARIABLE one of J1, preload"),
        ("J1=0.01", "allowed is VARIABLE.KEY=VALUE"),
        ("J1.sigma=0.01", "unknown key"),
        ("J1.std=-1", "variables.J1.std = -1"),
        ("J1.std=wide", "must be a number"),
        ("preload.lower=2.0", "not below upper"),
        ("J1.distribution=gauss", "unknown distribution"),
    ],
)
def test_a_setting_that_cannot_be_is_one_message(campaign, setting, said):
    """It names the key, and what is allowed."""
    with pytest.raises(SpecError, match="--set") as error:
        changed_variables(campaign.spec, [setting])
    assert said in str(error.value)
