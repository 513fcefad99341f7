"""How far a spread may grow: against the closed form of a weighted sum, by either method."""

import math

import numpy as np
import pytest
from scipy import stats

from reporting import ReportError
from reporting.tolerance.advice import CONTRIBUTIONS, LEAST_FACTOR, MOST_FACTOR, REWEIGHTING, advise
from reporting.tolerance.reweighting import Change

RNG = np.random.default_rng(41)
N = 40_000
A = np.array([1.0, 0.5, 0.25])
Z = RNG.normal(size=(N, 3))
Y = Z @ A
SIGMA = math.sqrt(np.sum(A**2))
SHARES = {f"J{i + 1}": a**2 / SIGMA**2 for i, a in enumerate(A)}


def widen(variable, factor, rows):
    """Return the change of one normal variable's sigma."""
    z = Z[rows, int(variable[1]) - 1]
    return Change(stats.norm.logpdf(z, scale=factor) - stats.norm.logpdf(z))


def ask(cpk_now, target, change=widen, variables=("J1", "J2", "J3")):
    """Return the advice on a response with limits that give it an index now."""
    limit = 3 * cpk_now * SIGMA
    return advise({"y": Y}, {"y": (-limit, limit)}, {"y": target}, {"y": SHARES}, variables, change)


def exact(variable, cpk_now, target):
    """Return sqrt(1 + ((now / target)^2 - 1) / S): the factor of sigma_i that brings Cpk to its target."""
    grown = 1 + ((cpk_now / target) ** 2 - 1) / SHARES[variable]
    return math.sqrt(grown) if grown > 0 else None


def test_a_weighted_sum_in_closed_form():
    """Within 2 %: Cpk of 40,000 samples is known to 0.4 %, and a small share makes much of it."""
    for advice in ask(1.5, 1.33)[:2]:
        factor = exact(advice.variable, 1.5, 1.33)
        assert advice.factor == pytest.approx(factor, rel=0.025)
        assert advice.bounded
        assert advice.binding == "y"
    first = ask(1.5, 1.33)[0]
    assert first.method == REWEIGHTING
    assert first.effective > 1000
    assert first.cpk == pytest.approx(1.33, abs=2e-3)


def test_beyond_the_reach_of_weights_the_contributions_answer():
    """J2 may grow to 2.5: the weights of such a sigma have too heavy a tail."""
    (advice,) = ask(1.9, 1.33, variables=("J2",))
    assert advice.method == CONTRIBUTIONS
    assert advice.factor == pytest.approx(exact("J2", 1.9, 1.33), rel=0.03)
    assert advice.effective is None


def test_what_misses_its_target_must_shrink():
    """J1 shrinks to the closed form; J3 cannot help however small it is."""
    first, _, third = ask(1.25, 1.33)
    assert first.factor == pytest.approx(exact("J1", 1.25, 1.33), rel=0.02)
    assert first.factor < 1
    assert exact("J3", 1.1, 1.33) is None
    third = ask(1.1, 1.33)[2]
    assert (third.factor, third.binding) == (None, "y")
    assert third.cpk < 1.33
    assert LEAST_FACTOR < 0.1


def test_an_idle_variable_may_grow_to_the_end():
    """Not bounded: every response keeps its target at the largest factor tried."""
    (advice,) = ask(30.0, 1.33, variables=("J3",))
    assert (advice.factor, advice.bounded) == (MOST_FACTOR, False)


def test_a_law_that_cannot_follow_says_how_far_it_went():
    """`spread` is what the contributions go by."""

    def shy(variable, factor, rows):
        return Change(np.zeros(rows.size), outside=0.5, spread=1 + (factor - 1) / 2)

    (advice,) = ask(1.6, 1.33, shy, ("J1",))
    assert advice.method == CONTRIBUTIONS
    assert 1 + (advice.factor - 1) / 2 == pytest.approx(exact("J1", 1.6, 1.33), rel=0.02)


def test_the_tightest_response_binds():
    """Two responses, one with more to spare; one without spread and one without limits set no bound."""
    wide, narrow = 3 * 2.0 * SIGMA, 3 * 1.5 * SIGMA
    responses = {"wide": Y, "narrow": Y, "flat": np.ones(N), "free": Y, "holes": np.where(Y > 3, np.nan, Y)}
    limits = {"wide": (-wide, wide), "narrow": (-narrow, narrow), "flat": (0.0, 2.0), "free": (None, None),
              "holes": (-wide, None)}  # fmt: skip
    shares = dict.fromkeys(responses, SHARES)
    (advice,) = advise(responses, limits, dict.fromkeys(responses, 1.33), shares, ["J1"], widen)
    assert advice.binding == "narrow"
    assert advice.factor == pytest.approx(exact("J1", 1.5, 1.33), rel=0.03)
    with pytest.raises(ReportError, match="no response has limits"):
        advise({"free": Y}, limits, {"free": 1.33}, shares, ["J1"], widen)
