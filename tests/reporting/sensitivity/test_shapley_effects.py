"""Correlated variables: Shapley effects against exact ones, and verdicts on who acts itself."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from reporting.sensitivity.first_order import jackknife_quantile
from reporting.sensitivity.polynomials import groups_of
from reporting.sensitivity.shapley_effects import shapley_effects, total_effects
from reporting.sensitivity.summary import sensitivity
from tests.reporting.models import named


def correlated(n, correlation, seed):
    """Return normal variables (n, k)."""
    z = np.random.default_rng(seed).normal(size=(n, len(correlation)))
    return z @ np.linalg.cholesky(correlation).T


def pair(rho, k=3):
    """Return the correlations of k variables, the first two correlated."""
    r = np.eye(k)
    r[0, 1] = r[1, 0] = rho
    return r


def exact(weights, correlation):
    """Return the Shapley effects of a weighted sum, order by order."""
    covariance, variance, k = correlation @ weights, weights @ correlation @ weights, len(weights)

    def worth(members):
        own = np.ix_(members, members)
        return covariance[members] @ np.linalg.solve(correlation[own], covariance[members]) / variance

    shares = np.zeros(k)
    for order in itertools.permutations(range(k)):
        for at, i in enumerate(order):
            shares[i] += worth(list(order[: at + 1])) - (worth(list(order[:at])) if at else 0.0)
    return shares / math.factorial(k)


def step_truth(rho, at):
    """Return the Shapley effects of a step of the first of two variables."""
    p, both = stats.norm.sf(at), stats.multivariate_normal.cdf([-at, -at], cov=[[1, rho**2], [rho**2, 1]])
    alone = (both - p * p) / (p - p * p)
    return np.array([1 - alone / 2, alone / 2])


WEIGHTS = np.array([1.0, 1.0, 0.3])
CASES = {
    "sum": (pair(-0.9), lambda z: z @ WEIGHTS, exact(WEIGHTS, pair(-0.9))),
    "idle": (pair(0.8), lambda z: z @ [1.0, 0.0, 0.5], exact(np.array([1.0, 0.0, 0.5]), pair(0.8))),
    "product": (pair(0.6), lambda z: z[:, 0] * z[:, 1] + z[:, 2], np.array([0.68, 0.68, 1.0]) / 2.36),
    "step": (pair(0.8, 2), lambda z: 1.0 * (z[:, 0] > 1), step_truth(0.8, 1.0)),
}


def effects(z, y):
    """Return the Shapley effects on one response."""
    return shapley_effects(z, y[:, None], groups_of(y.size), np.diag(np.linalg.inv(np.corrcoef(z.T))))


@pytest.mark.parametrize("case", CASES)
def test_shares_are_the_exact_ones(case):
    """Of sums, a product and a step, whose share is not left unexplained."""
    correlation, model, truth = CASES[case]
    z = correlated(20_000, correlation, 3)
    found = effects(z, model(z))
    assert np.all(np.abs(found.share[0] - truth) < 3.5 * found.share_error[0] + 1e-3)
    assert found.share_error.max() < 0.012
    assert found.remainder[0] == pytest.approx(0.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("n", [100, 500])
def test_intervals_of_shares_hold(n):
    """In at least 80 % of 50 samples each, 90 % over all (95 % meant)."""
    quantile, held = jackknife_quantile(20, 0.95), []
    for correlation, model, truth in CASES.values():
        for seed in range(50):
            z = correlated(n, correlation, seed)
            found = effects(z, model(z))
            held.append(np.mean(np.abs(found.share[0] - truth) <= quantile * found.share_error[0] + 1e-9))
    assert np.reshape(held, (len(CASES), 50)).mean(axis=1).min() >= 0.8
    assert np.mean(held) >= 0.9


def test_variables_that_hide_each_other_are_critical():
    """Correlation -0.9: first-order indices of 0.05 and less called the two main variables not critical."""
    z = correlated(3000, pair(-0.9), 4)
    response = sensitivity(named(z), {"y": z @ WEIGHTS}).responses[0]
    assert [i.verdict for i in response.influences] == ["critical"] * 3
    assert max(i.first_order for i in response.influences[:2]) < 0.08
    assert sum(i.shapley for i in response.influences) == pytest.approx(1.0, abs=1e-6)
    assert response.influences[0].own == pytest.approx(1 / 0.29, rel=0.1)
    assert response.influences[0].share == response.influences[0].shapley


def test_a_variable_without_effect_is_only_correlated():
    """It has a share, through J1; it is critical for no response; and too few noisy samples leave it open."""
    z = correlated(3000, pair(0.8), 5)
    found = sensitivity(named(z), {"y": z @ [1.0, 0.0, 0.5]})
    idle = found.responses[0].influences[1]
    assert (idle.verdict, idle.through) == ("only correlated", ("J1",))
    assert idle.shapley > 0.2
    assert idle.own_interval[1] < 0.01
    assert "J2 has 2" in found.responses[0].notes[-1]
    assert "only through its correlation with J1" in found.responses[0].notes[-1]
    assert found.never_critical() == ("J2",)
    few = z[:100], z[:100, 0] + 0.3 * np.random.default_rng(6).normal(size=100)
    assert sensitivity(named(few[0]), {"y": few[1]}).responses[0].influences[1].verdict == "open"


def test_what_is_requested_decides():
    """A requested correlation of 0.05 counts, a chance one does not, and a gross one does even so."""
    z = correlated(5000, pair(0.05, 2), 7)
    asked = sensitivity(named(z), {"y": z @ [1.4, 1.0]}, correlations=[("J1", "J2", 0.05)]).responses[0]
    truth = (1.4 + 0.05) ** 2 / (1.4**2 + 1 + 2 * 0.05 * 1.4)
    low, high = asked.influences[0].first_order_interval
    assert asked.independent is False
    assert low <= truth <= high
    lot = np.repeat(np.arange(10), 50)  # ten lots: correlated by chance
    few = np.random.default_rng(8).normal(size=(10, 2))[lot]
    few = few + 0.1 * np.random.default_rng(9).normal(size=few.shape)
    assert abs(np.corrcoef(few.T)[0, 1]) > 0.2
    of_lots = sensitivity(named(few), {"y": few @ [1.0, 1.0]}, correlations=[], lots=lot).responses[0]
    assert of_lots.independent
    assert "10 production lots" in of_lots.notes[-1]
    assert not sensitivity(named(few), {"y": few @ [1.0, 1.0]}).responses[0].independent
    alike = correlated(500, pair(0.6, 2), 9)
    assert not sensitivity(named(alike), {"y": alike @ [1.0, 1.0]}, correlations=[]).responses[0].independent


def test_no_note_recommends_a_sampler_that_refuses_correlations():
    """A product of correlated variables, cut twice, leaves much; saltelli needs independent variables."""
    z = correlated(2000, pair(0.5, 4), 10)
    y = np.sign(z[:, 0] * z[:, 2] * z[:, 3])
    response = sensitivity(named(z), {"y": y}, correlations=[("J1", "J2", 0.5)]).responses[0]
    notes = " ".join(response.notes)
    assert "saltelli" not in notes
    assert "is in no Shapley effect" in notes
    assert {i.verdict for i in response.influences} <= {"open", "critical"}
    assert response.verdict == "open"


def test_more_variables_than_subsets_can_be_fitted_get_no_verdict():
    """Eleven correlated ones."""
    z = correlated(1000, pair(0.5, 11), 11)
    response = sensitivity(named(z), {"y": z.sum(axis=1)}).responses[0]
    assert {i.verdict for i in response.influences} == {"open"}
    assert "at most 10 variables: no verdict" in response.notes[0]


def of_independent(draw, response, n, count=25):
    """Return the sensitivities of `count` samples of a response to independent variables."""
    found = []
    for seed in range(count):
        x = draw(np.random.default_rng(seed), n)
        found.append(sensitivity(named(x), {"y": response(x)}).responses[0])
    return found


def normals(rng, n):
    return rng.normal(size=(n, 3))


def test_a_step_does_not_count_as_interaction():
    """A step and a straight line: no interaction, in 200 and 2,000 samples; polynomials alone found some in 85 %."""
    for n in (200, 2000):
        found = of_independent(normals, lambda x: 2.0 * (x[:, 0] > 1) + 0.5 * x[:, 1], n, 10)
        assert sum(each.interaction_interval[0] <= 1e-9 for each in found) >= 9


def test_two_jumps_together_are_an_interaction():
    """Where both exceed their middle: a third of the variance is their interaction; three errors of 25 samples."""
    truth = 1 - (2 * 0.0625 + 0.01 / 12) / (0.1875 + 0.01 / 12)
    found = of_independent(
        lambda rng, n: rng.uniform(size=(n, 3)),
        lambda x: 1.0 * ((x[:, 0] > 0.5) & (x[:, 1] > 0.5)) + 0.1 * x[:, 2],
        200,
    )
    ends = np.array([each.interaction_interval for each in found])
    assert np.mean((ends[:, 0] <= truth) & (truth <= ends[:, 1])) >= 0.95 - 3 * (0.95 * 0.05 / 25) ** 0.5


def test_interactions_where_a_response_bends_in_its_tails():
    """exp(0.5 z) of a weighted sum z: the share is exact; three errors of 60 samples, and no bias."""
    weights = np.sqrt([0.5, 0.3, 0.2])
    truth = 1 - np.sum(np.expm1(0.25 * weights**2)) / np.expm1(0.25)
    found = of_independent(normals, lambda x: np.exp(0.5 * x @ weights), 500, 60)
    ends = np.array([each.interaction_interval for each in found])
    assert np.mean((ends[:, 0] <= truth) & (truth <= ends[:, 1])) >= 0.95 - 3 * (0.95 * 0.05 / 60) ** 0.5
    assert np.mean([each.interaction for each in found]) == pytest.approx(truth, rel=0.06)


def test_a_share_of_interactions_that_few_samples_determine_is_called_so():
    """Rare values add to it in a tail of power 3 and in a long exponential one, but not in a short one."""

    def said(curve, n):
        ones = of_independent(normals, lambda x: curve(x @ np.sqrt([0.6, 0.4, 0.0])), n, 5)
        return sum(any("determine the share of interactions" in note for note in one.notes) for one in ones)

    assert said(lambda z: stats.t.ppf(stats.norm.cdf(z), 3), 5000) == 5
    assert said(np.exp, 500) == 5
    assert said(lambda z: np.exp(0.3 * z), 5000) == 0
    assert said(np.tanh, 5000) == said(lambda z: z, 50) == 0


def test_what_acts_in_products_only_is_critical_and_what_does_not_act_is_not():
    """A product, whose first-order indices are 0; the g function (Saltelli, Sobol' 1995), with three idle inputs."""
    for each in of_independent(normals, lambda x: x[:, 0] * x[:, 1] + 0.3 * x[:, 2], 500, 5):
        assert [i.verdict for i in each.influences[:2]] == ["critical"] * 2
        assert any("regression with products" in note for note in each.notes)
    a = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0, 99.0])
    for each in of_independent(
        lambda rng, n: rng.uniform(size=(n, 7)), lambda x: np.prod((abs(4 * x - 2) + a) / (1 + a), axis=1), 5000, 2
    ):
        words = [i.verdict for i in each.influences]
        assert words[:2] == ["critical"] * 2
        assert words[4:] == ["not critical"] * 3


def test_total_effects_are_those_of_a_product():
    """``x0 x1 + 0.3 x2``: totals 1 / 1.09, 1 / 1.09 and 0.09 / 1.09; nothing remains."""
    x = normals(np.random.default_rng(1), 20_000)
    (found,) = total_effects(x, (x[:, 0] * x[:, 1] + 0.3 * x[:, 2])[:, None], groups_of(20_000))
    assert found.total[0] == pytest.approx(np.array([1.0, 1.0, 0.09]) / 1.09, abs=0.02)
    assert found.interaction[0] == pytest.approx(1 / 1.09, abs=0.02)
    assert found.remainder[0] == pytest.approx(0.0, abs=1e-9)
    assert total_effects(np.zeros((9, 11)), np.zeros((9, 1)), groups_of(9)) == []
