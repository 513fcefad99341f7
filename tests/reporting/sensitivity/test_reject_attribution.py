"""Which variable costs the rejects, against shares that follow from the bivariate normal distribution."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from reporting import ReportError
from reporting.sensitivity.reject_attribution import reject_attribution


def exact(weights, correlation, threshold):
    """Return the Shapley effects of ``weights @ z > threshold`` sigma, by the orders of the variables, one by one."""
    r, k = np.asarray(correlation), len(weights)
    covariance, variance, p = r @ weights, weights @ r @ weights, stats.norm.sf(threshold)

    def worth(members):
        if not members:
            return 0.0
        own = np.ix_(members, members)
        explained = min(covariance[members] @ np.linalg.solve(r[own], covariance[members]) / variance, 1 - 1e-9)
        both = stats.multivariate_normal.cdf(
            [-threshold] * 2, cov=[[1, explained], [explained, 1]], allow_singular=True
        )
        return (both - p * p) / (p - p * p)

    shares = np.zeros(k)
    for order in itertools.permutations(range(k)):
        for at, i in enumerate(order):
            shares[i] += worth(list(order[: at + 1])) - worth(list(order[:at]))
    return shares / math.factorial(k)


def named(z):
    """Return columns of other units and origins, by name."""
    return {f"J{i + 1}": 10.0 * i + 0.01 * column for i, column in enumerate(z.T)}


INDEPENDENT, MIXED = np.eye(4), np.array([[1, 0.6, 0, 0], [0.6, 1, 0, 0], [0, 0, 1, -0.5], [0, 0, -0.5, 1]])


@pytest.mark.parametrize(("correlation", "n"), [(INDEPENDENT, 1500), (INDEPENDENT, 20_000), (MIXED, 20_000)])
def test_shares_of_a_weighted_sum(correlation, n):
    """Rejects beyond 2 sigma, about 34 or 455: the truth is in the intervals, and the shares add up to the whole."""
    weights = np.array([3.0, 1.5, 1.0, 0.0])
    truth, rng = exact(weights, correlation, 2.0), np.random.default_rng(5)
    z = rng.normal(size=(n, 4)) @ np.linalg.cholesky(correlation).T
    y = z @ weights
    found = reject_attribution(named(z), y > 2.0 * math.sqrt(weights @ correlation @ weights))
    shares = {s.variable: s for s in found.shares}
    assert sum(s.share for s in found.shares) == pytest.approx(1.0)
    assert [s.share for s in found.shares] == sorted((s.share for s in found.shares), reverse=True)
    for i, share in enumerate(truth):
        low, high = shares[f"J{i + 1}"].interval
        assert low - 0.005 <= share <= high + 0.005
        assert shares[f"J{i + 1}"].share == pytest.approx(share, abs=0.12 if n < 5000 else 0.05)


@pytest.mark.parametrize("rejected", [lambda z: np.abs(z[:, 1]) > 2.3, lambda z: z[:, 1] < -2.0])
def test_one_cause_is_named_alone(rejected):
    """Of rejects at either side or one."""
    z = np.random.default_rng(6).normal(size=(4000, 5))
    found = reject_attribution(named(z), rejected(z))
    assert found.shares[0].variable == "J2"
    assert found.shares[0].share > 0.9
    assert max(s.share for s in found.shares[1:]) < 0.05
    assert found.note == ""


def test_two_causes_share_the_rejects():
    """J1 too large or J4 too small, as often: half each; so do factors of a product, which act only together."""
    z = np.random.default_rng(7).normal(size=(10_000, 4))
    for rejected in ((z[:, 0] > 2.3) | (z[:, 3] < -2.3), z[:, 0] * z[:, 3] > 3):
        found = reject_attribution(named(z), rejected)
        assert {s.variable for s in found.shares[:2]} == {"J1", "J4"}
        assert found.shares[0].share == pytest.approx(0.5, abs=0.08)


def test_few_rejects_name_no_cause():
    """Nine are too few, ten give wide intervals and say so; the same of conforming samples."""
    z = np.random.default_rng(8).normal(size=(3000, 3))
    order = np.argsort(-z[:, 0])
    for count, text in ((0, "few rejects (0)"), (9, "few rejects (9)"), (2995, "few conforming samples (5)")):
        rejected = np.zeros(3000, bool)
        rejected[order[:count]] = True
        found = reject_attribution(named(z), rejected)
        assert (found.rejects, found.shares, found.resolved) == (count, (), None)
        assert text in found.note
    rejected = np.zeros(3000, bool)
    rejected[order[:10]] = True
    found = reject_attribution(named(z), rejected)
    assert found.shares[0].variable == "J1"
    assert found.shares[0].interval[1] - found.shares[0].interval[0] > 0.2
    assert "10 rejects only" in found.note


def test_rejects_by_chance_have_no_cause():
    """Rejects that do not depend on the variables are blamed on none."""
    rng = np.random.default_rng(9)
    for _ in range(10):
        found = reject_attribution(named(rng.normal(size=(1000, 5))), rng.random(1000) < 0.05)
        assert found.shares == ()
        assert "no cause is named" in found.note


def test_many_variables_and_odd_columns():
    """Twelve variables: eight have a share; constants, holes and another order of the columns change nothing."""
    rng = np.random.default_rng(10)
    z = rng.normal(size=(1000, 12))
    rejected = z[:, 10] + 0.5 * z[:, 2] > 2
    inputs = {**named(z), "fixed": np.full(1000, 0.1)}
    found = reject_attribution(inputs, rejected)
    assert [s.variable for s in found.shares[:2]] == ["J11", "J3"]
    assert len(found.shares) == 13
    assert "8 variables" in found.note
    few = {name: inputs[name] for name in ("J1", "J11", "J3", "fixed")}
    found = reject_attribution(few, rejected)
    turned = reject_attribution(dict(reversed(few.items())), rejected)
    assert {s.variable: s.share for s in turned.shares} == pytest.approx({s.variable: s.share for s in found.shares})
    few["J1"][:100] = math.nan
    assert reject_attribution(few, rejected).n == 900


def test_lots_widen_the_intervals():
    """Twenty lots whose shifts hold most of the spread say less than as many independent samples."""
    rng = np.random.default_rng(11)
    lot = np.repeat(np.arange(20), 200)
    z = 0.3 * rng.normal(size=(4000, 2)) + rng.normal(size=(20, 2))[lot]
    rejected = z @ [1.0, 1.0] > 1.2
    widths = [
        [s.interval[1] - s.interval[0] for s in reject_attribution(named(z), rejected, lots=lots).shares]
        for lots in (None, lot)
    ]
    assert min(widths[1]) > 1.5 * max(widths[0])
    assert "few production lots (2)" in reject_attribution(named(z), rejected, lots=lot // 10).note


def test_columns_of_different_lengths_are_refused():
    """As everywhere."""
    with pytest.raises(ReportError, match="differ in length"):
        reject_attribution({"a": np.zeros(5)}, np.zeros(6, bool))
