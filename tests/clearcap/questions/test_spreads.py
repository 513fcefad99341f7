"""Variables with other standard deviations: against known laws, and never beyond bounds or what the mechanism takes."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy import stats

from campaign.inputs.distributions import Variable
from campaign.inputs.sampling import draw
from clearcap.questions.tolerances import Spreads, with_spread
from clearcap.questions.whatif import changed_variables
from tests.each import each


def cut(mean: float, std: float) -> stats.rv_continuous:
    """Return the truncated normal distribution of J1."""
    return stats.truncnorm((0.01 - mean) / std, (0.13 - mean) / std, mean, std)


def variable(**table):
    """Return a variable."""
    return TypeAdapter(Variable).validate_python(table)


def test_widening_follows_the_law_and_says_how_far_it_came(campaign):
    """A factor is of the spread inside the bounds, which allow no more than that of a uniform law on them."""
    columns = draw(campaign.spec, 0, 25)
    now = cut(0.07, 0.0175).std()
    for factor in (0.6, 1.5, 1.9):
        found = Spreads(campaign.spec).change({"J1": factor}, columns)
        assert found.spread == factor
        law = with_spread(campaign.spec.variables["J1"], factor).law
        assert cut(0.07, law.std).std() == pytest.approx(factor * now, rel=1e-5)
        drawn = Spreads(campaign.spec).drawn({"J1": factor})["J1"]
        assert drawn.std() == pytest.approx(factor * now, rel=1e-3)
    most = Spreads(campaign.spec).change({"J1": 4.0}, columns)
    assert most.spread == pytest.approx(0.12 / np.sqrt(12) / now, rel=1e-5)
    assert np.ptp(most.log_ratio - cut(0.07, 0.0175).logpdf(columns["J1"]) * -1) < 1e-5
    assert "bounds" in most.limit
    assert found.limit == ""
    (setting,) = found.settings
    assert setting.startswith("J1.std=0.")


def test_a_uniform_variable_fills_its_bounds(campaign):
    """It may be drawn in, and never grows: its values never leave the bounds."""
    columns = draw(campaign.spec, 0, 25)
    wider = Spreads(campaign.spec).change({"preload": 1.25}, columns)
    assert (wider.spread, wider.limit) == (1.0, "its bounds allow no more")
    both = Spreads(campaign.spec).change({"J1": 1.5, "preload": 0.5}, columns)
    inside = np.abs(columns["preload"] - 0.95) <= 0.025
    alone = Spreads(campaign.spec).change({"J1": 1.5}, columns)
    np.testing.assert_allclose(both.log_ratio[inside], alone.log_ratio[inside] + np.log(2), rtol=1e-9)
    assert np.all(both.log_ratio[~inside] == -np.inf)
    drawn = Spreads(campaign.spec).drawn({"J1": 1.5, "preload": 0.5})["preload"]
    assert (drawn.min(), drawn.max()) == pytest.approx((0.925, 0.975), abs=1e-4)
    assert both.settings[1:] == ("preload.lower=0.925", "preload.upper=0.975")


KINDS = {
    "truncated": {"distribution": "truncated_normal", "mean": 0.06, "std": 0.02, "lower": 0.01, "upper": 0.13},
    "toleranced": {"distribution": "normal", "nominal": 0.06, "tolerance": 0.03, "cpk": 1.0},
    "inertial": {"distribution": "normal", "nominal": 0.06, "inertia": 0.01, "shift": 0.004},
    "shifted": {"distribution": "normal", "nominal": 0.06, "tolerance": 0.03, "cpk": 1.0, "sigma_shift": 1.5},
    "drawn": {"distribution": "truncated_normal", "fit": "25 F8/h9", "cpk": 1.0},
    "position": {"distribution": "position", "zone": 0.1, "std": 0.02},
    "placed": {"distribution": "position", "zone": 0.1},
    "selective": {"distribution": "selective", "fit": "25 F8/h9", "cpk": 1.0, "classes": 3},
    "triangular": {"distribution": "triangular", "lower": 0.02, "upper": 0.1, "mode": 0.03, "within": [0.03, 0.09]},
    "beta": {"distribution": "beta", "lower": 0.0, "upper": 0.1, "alpha": 3.0, "beta": 4.0},
    "lognormal": {"distribution": "lognormal", "log_mean": -2.8, "log_std": 0.3, "upper": 0.2},
    "weibull": {"distribution": "weibull", "shape": 3.0, "scale": 0.06},
    "gamma": {"distribution": "gamma", "shape": 9.0, "scale": 0.007},
    "exponential": {"distribution": "exponential", "scale": 0.02, "origin": 0.01},
    "batches": {"distribution": "normal", "mean": 0.06, "std": 0.01, "batch": {"size": 5, "std": 0.005}},
}


@each("kind", KINDS)
def test_what_is_to_be_written_gives_the_spread(campaign, kind):
    """The settings of a factor, given to whatif, make a law of that factor."""
    old = variable(**KINDS[kind])
    spec = campaign.spec.model_copy(update={"variables": {"J1": old}})
    x = old.ppf(np.linspace(0.02, 0.98, 25))
    for factor in (0.6, 1.3):
        change = Spreads(spec).change({"J1": factor}, {"J1": x})
        if change.limit:
            assert kind in ("triangular", "selective")  # between ends that no spread moves
            continue
        new = changed_variables(spec, change.settings).variables["J1"]
        assert new.moments()[1] == pytest.approx(factor * old.moments()[1], rel=1e-4)
        assert type(new) is type(old)
        rounded = changed_variables(spec, change.written).variables["J1"]
        assert rounded.moments()[1] == pytest.approx(factor * old.moments()[1], rel=0.02)
        assert max(len(text.partition("=")[2].lstrip("[-").split(",")[0]) for text in change.written) <= 8
        assert old.support()[0] <= new.support()[0] or not np.isfinite(new.support()[0])


def test_a_cut_tail_has_a_largest_spread(campaign):
    """A lognormal law cut at 0.2: beyond some sigma before the cut, the one within the bounds falls again."""
    old = variable(**KINDS["lognormal"])
    most = with_spread(old, 10.0)
    tried = [variable(**KINDS["lognormal"] | {"log_mean": m, "log_std": s}) for m, s in _same_mean(0.3, 3.0)]
    assert most.factor == pytest.approx(max(law.moments()[1] for law in tried) / old.moments()[1], rel=1e-3)
    assert with_spread(old, 0.99 * most.factor).limit == ""
    assert "bounds" in most.limit


def _same_mean(low, high):
    """Yield parameters of lognormal laws with the mean before the cut of that one, and deviations of the logarithm."""
    for s in np.linspace(low, high, 300):
        yield -2.8 + 0.3**2 / 2 - s * s / 2, float(s)


def test_separate_values_have_no_factor(campaign):
    """A count and measured values: the reason is said, in both directions."""
    count = variable(distribution="poisson", rate=4.0, step=0.01)
    for factor in (0.5, 2.0):
        assert (with_spread(count, factor).factor, with_spread(count, factor).limit[:23]) == (
            1.0,
            "its values are separate",
        )


def test_the_mechanism_ends_what_no_bound_ends(campaign):
    """An unbounded clearance of 0.07 +- 0.005 grows until its outermost value is 0, and no farther."""
    free = variable(distribution="normal", mean=0.07, std=0.005)
    spec = campaign.spec.model_copy(update={"variables": {"J1": free}})
    most = Spreads(spec, campaign.mechanism).of_variable("J1", 8.0)
    assert most.law.ends()[0] == pytest.approx(0.0, abs=1e-3)
    assert most.law.ends()[0] >= 0
    assert 2.9 < most.factor < 2.95  # 0.07 / (4.75 * 0.005)
    assert "which the mechanism refuses" in most.limit
    assert Spreads(spec).of_variable("J1", 8.0).factor == 8.0


def test_a_spread_may_be_limited_by_parameters_and_follows_production_batches(campaign):
    """A beta distribution has no more than sqrt((mean - lower)(upper - mean)); shifts of batches grow with the rest."""
    table = {"distribution": "beta", "lower": 0.0, "upper": 1.0, "mean": 0.5, "std": 0.2}
    beta = campaign.spec.model_copy(update={"variables": {"b": variable(**table)}})
    columns = {"b": np.linspace(0.05, 0.95, 25)}
    assert Spreads(beta).change({"b": 1.5}, columns).spread == 1.5
    assert Spreads(beta).change({"b": 4.0}, columns).spread == pytest.approx(2.5, rel=1e-3)
    shifting = variable(distribution="normal", mean=1.0, std=0.1, batch={"size": 5, "std": 0.1})
    law = with_spread(shifting, 1.7).law
    assert (law.std, law.batch.std) == (pytest.approx(0.17), pytest.approx(0.17))
