"""Productions: what the study takes for true is true of what it draws."""

import numpy as np
import pytest
from scipy import stats

from studies.coverage.productions import IN_ORDER, JUMPS, LOTS, MORE_SHAPES, SHAPES, SHARES, Production, first_order
from studies.coverage.shapes import CURVES, distance_from_normal, moments, share_within, truth
from tests.each import each

pytestmark = pytest.mark.slow

KNOWN = {
    "normal": stats.norm(),
    "lognormal": stats.lognorm(0.5),
    "gamma": stats.gamma(16),
    "t5": stats.t(5),
    "uniform": stats.uniform(),
    "folded normal": stats.foldnorm(1),
    "skew normal, 5": stats.skewnorm(5),
    "arcsine": stats.arcsine(),
    "lognormal (1)": stats.lognorm(1),
}


@pytest.mark.parametrize("shape", KNOWN)
def test_moments_and_quantiles_are_those_of_the_distribution(shape):
    mean, std = moments(shape)
    assert (mean, std) == pytest.approx((KNOWN[shape].mean(), KNOWN[shape].std()), abs=1e-7)
    true = truth(shape)
    assert [true.low, true.median, true.high] == pytest.approx(KNOWN[shape].ppf(stats.norm.cdf([-3, 0, 3])), abs=1e-9)
    assert true.above == pytest.approx(1e6 * KNOWN[shape].sf(true.usl))


def test_two_normals():
    """Four sigmas apart, so sigma is the root of 1 + 2^2."""
    assert moments("bimodal") == pytest.approx((0.0, 5**0.5), abs=1e-9)
    share = stats.norm.cdf(truth("bimodal").usl, (-2, 2)).mean()
    assert 1e6 * (1 - share) == pytest.approx(truth("bimodal").above, rel=1e-6)


@pytest.mark.parametrize(("share", "shift"), [(0.01, 6.0), (0.002, 8.0), (0.2, 3.0)])
def test_a_second_population(share, shift):
    """Its variance adds that between the two."""
    name = f"{100 * share:g} % shifted by {shift:g} sigmas"
    assert moments(name) == pytest.approx((share * shift, (1 + share * (1 - share) * shift**2) ** 0.5), abs=1e-4)
    true = truth(name)
    shares = [(1 - share) * stats.norm.sf(x) + share * stats.norm.sf(x - shift) for x in (true.lsl, true.usl)]
    assert (true.below, true.above) == pytest.approx((1e6 * (1 - shares[0]), 1e6 * shares[1]), rel=1e-4)


def test_values_with_a_share_of_their_own():
    """A limit on such a value keeps it; so does an interval that ends there."""
    stop = truth("a tenth at a stop")
    assert (stop.below, stop.lsl) == (0.0, pytest.approx(stats.norm.ppf(0.1)))
    assert stop.above == pytest.approx(1e6 * stats.norm.sf(3))
    rounded = truth("rounded to half a sigma")
    assert (rounded.below, rounded.above) == pytest.approx(tuple(1e6 * stats.norm.sf([3.75, 3.25])), rel=1e-9)
    assert share_within("rounded to a sigma", -1.0, 1.0) == pytest.approx(
        stats.norm.cdf(1.5) - stats.norm.cdf(-1.5), abs=2e-3
    )
    assert share_within("a tenth at a stop", stop.lsl, np.inf) == pytest.approx(1.0)
    assert share_within("uniform", 0.2, 0.7) == pytest.approx(0.5, abs=1e-5)


def test_a_spread_score():
    """A lognormal whose score has another sigma is a lognormal with that times its own."""
    mean, std = moments("lognormal", 1.3)
    assert (mean, std) == pytest.approx((stats.lognorm(0.65).mean(), stats.lognorm(0.65).std()), rel=1e-9)
    true = truth("lognormal", 1.3)
    assert true.ppm == pytest.approx(1e6 * (stats.lognorm(0.65).cdf(true.lsl) + stats.lognorm(0.65).sf(true.usl)))


def test_first_order_indices_of_a_lognormal():
    """By Sobol's (2001) formula for a product: (exp(s^2 a) - 1) / (exp(s^2) - 1)."""
    expected = [np.expm1(0.25 * a) / np.expm1(0.25) for a in (0.5, 0.3, 0.15, 0.05, 0.0)]
    assert first_order(Production("lognormal", "lognormal")) == pytest.approx(expected, abs=1e-9)


@each("production", [*SHAPES, *MORE_SHAPES, *LOTS, *IN_ORDER])
def test_draws_have_the_truth(production):
    """Over many campaigns, within five standard errors."""
    true = truth(production.shape)
    rng = np.random.default_rng(7)
    draws = np.array([production.draw(50, rng) for _ in range(2000)])
    errors = draws.mean(axis=1).std() / 2000**0.5
    assert abs(draws.mean() - true.mean) < 5 * errors
    if "rounded" not in production.name:
        bar = CURVES[production.shape](np.array([1.0]))[0]
        assert np.mean(draws > bar) == pytest.approx(stats.norm.sf(1), abs=0.03)


def test_lots_share_a_shift():
    """With equal sigmas half of the variance lies between lots; unequal lots grow."""
    lots = Production("lots", "normal", 4, growth=2.0)
    assert np.bincount(lots.lot_of(150)).tolist() == [10, 20, 40, 80]
    even = Production("lots", "normal", 500)
    y = even.draw(5000, np.random.default_rng(3)).reshape(500, 10)
    assert y.var(axis=1, ddof=1).mean() == pytest.approx(0.5, rel=0.1)
    assert y.var() == pytest.approx(1.0, rel=0.1)
    assert Production("none", "normal").lot_of(5) is None


@pytest.mark.parametrize("production", JUMPS[:3], ids=lambda each: each.name)
def test_first_order_indices_of_a_jump(production):
    """The variances of the conditional expectations, over many draws; two variables may jump only together."""
    x = production.variables(400_000, np.random.default_rng(5))
    y = production.values(x)
    alone = x * np.sqrt(SHARES)
    if production.together:
        alone[:, :2] += production.jump * 0.5 * (x[:, :2] > 0)
    else:
        alone[:, 0] += production.jump * (x[:, 0] > 1)
    assert first_order(production) == pytest.approx(alone.var(axis=0) / y.var(), abs=0.005)


def test_distance_from_normal():
    """None for a normal shape; that of a uniform one by a grid of its values."""
    assert distance_from_normal("normal") == pytest.approx(0, abs=1e-9)
    grid = np.linspace(0, 1, 100_001)
    assert distance_from_normal("uniform") == pytest.approx(
        np.abs(grid - stats.norm.cdf((grid - 0.5) * 12**0.5)).max(), abs=1e-5
    )
