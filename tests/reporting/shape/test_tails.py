"""Tails against scipy's Pareto fit, against known shares, and refusals."""

import numpy as np
import pytest
from scipy import stats

from reporting import ReportError
from reporting.shape import pareto
from reporting.shape.tails import MOST_EXCESSES, pareto_tails, tail_from_weights


@pytest.mark.parametrize("shape", [-0.3, 0.0, 0.2])
def test_the_pareto_fit_is_scipys(shape: float) -> None:
    y = np.sort(stats.genpareto(shape, scale=0.7).rvs(400, random_state=5))
    found = pareto.fit(y)
    known = stats.genpareto.fit(y, floc=0)
    best = stats.genpareto.logpdf(y, *known).sum()
    assert found.loglik == pytest.approx(best, abs=1e-3)
    assert found.shape == pytest.approx(known[0], abs=2e-3)
    assert found.scale == pytest.approx(known[2], rel=2e-3)
    model = stats.genpareto(found.shape, scale=found.scale)
    assert pareto.survival(3.0, found) == pytest.approx(model.sf(3.0), rel=1e-9)
    assert pareto.crookedness(y, found) == pytest.approx(stats.cramervonmises(y, model.cdf).statistic, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [-0.25, 0.1])
def test_the_goodness_check_rejects_one_good_tail_in_twenty(shape: float) -> None:
    """500 tails of 100 excesses; three binomial standard errors are 0.029."""
    draws = stats.genpareto(shape).rvs((500, 100), random_state=8)
    rejected = 0
    for y in np.sort(draws, axis=1):
        found = pareto.fit(y)
        rejected += pareto.crookedness(y, found) > pareto.critical_crookedness(found.shape)
    assert rejected / 500 == pytest.approx(0.05, abs=0.03)


@pytest.mark.slow
def test_the_profile_interval_covers_the_share() -> None:
    """200 samples of 150 exponential excesses, share e^-6; three binomial standard errors are 0.046."""
    draws = np.random.default_rng(1).exponential(size=(200, 150))
    inside = 0
    for y in draws:
        low, high = pareto.survival_interval(y, 6.0, pareto.fit(y), 0.95)
        inside += low <= np.exp(-6) <= high
    assert inside / 200 == pytest.approx(0.95, abs=0.047)


@pytest.mark.parametrize(("known", "limit"), [(stats.norm(), 4.0), (stats.t(5), 9.0), (stats.lognorm(0.3), 3.4)])
def test_the_tail_of_known_distributions(known, limit: float) -> None:
    """60 campaigns of 20,000: 20 to 140 ppm, a few rejects each; three binomial standard errors are 0.084."""
    rng = np.random.default_rng(8)
    ppm, inside, estimates = 1e6 * known.sf(limit), 0, []
    for _ in range(60):
        tail = pareto_tails(known.rvs(20_000, random_state=rng), None, limit)[0]
        low, high = tail.interval
        inside += low <= ppm <= high
        estimates.append(tail.ppm)
        assert tail.excesses <= MOST_EXCESSES
    assert inside / 60 >= 0.95 - 0.084
    assert 0.5 < np.median(estimates) / ppm < 1.5


def test_a_mirror_exchanges_the_sides() -> None:
    x = np.random.default_rng(2).gumbel(size=5000)
    above, below = pareto_tails(x, None, 9.0)[0], pareto_tails(-x, -9.0, None)[0]
    assert (above.side, below.side) == ("above", "below")
    assert (below.limit, below.threshold) == (-9.0, -above.threshold)
    assert (below.ppm, below.interval) == (above.ppm, above.interval)


def test_the_estimate_does_not_depend_on_the_unit() -> None:
    x = np.random.default_rng(2).gumbel(size=5000)
    one, other = pareto_tails(x, None, 9.0)[0], pareto_tails(1e3 * (x - 7), None, 2e3)[0]
    assert other.ppm == pytest.approx(one.ppm, rel=1e-4)
    assert other.interval == pytest.approx(one.interval, rel=1e-3)
    assert other.scale == pytest.approx(1e3 * one.scale, rel=1e-4)


@pytest.mark.parametrize(
    ("x", "limit", "said"),
    [
        (np.arange(40.0), 50.0, "too few for a tail: 500"),
        ([], 1.0, "too few"),
        ([np.nan] * 600, 1.0, "too few"),
        (np.random.default_rng(1).normal(size=5000), 1.0, "counted share is better"),
        (np.random.default_rng(1).normal(size=5000).round(1), 6.0, "repeat"),
        (np.full(1000, 3.0), 4.0, "all equal"),
        (np.random.default_rng(1).random(20_000), 1.01, "No threshold"),
    ],
)
def test_a_tail_that_is_not_valid_is_refused_with_the_reason(x, limit: float, said: str) -> None:
    (tail,) = pareto_tails(x, None, limit)
    assert tail.ppm is None
    assert tail.interval is None
    assert said in tail.note


def drawn(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return samples around 2 with sigma 1.2, and the weights that make them standard normal."""
    x = rng.normal(2, 1.2, n)
    return x, 3.7 * np.exp(stats.norm.logpdf(x) - stats.norm.logpdf(x, 2, 1.2))


def test_weighted_intervals_cover_the_share() -> None:
    """400 campaigns of 4,000, limit at 4 sigma; three binomial standard errors are 0.033, conservative by design."""
    truth, inside = 1e6 * stats.norm.sf(4.0), 0
    for i in range(400):
        (tail,) = tail_from_weights(*drawn(np.random.default_rng(i), 4000), None, 4.0)
        inside += tail.interval[0] <= truth <= tail.interval[1]
    assert 0.92 <= inside / 400 <= 1.0
    assert tail.interval[1] < 2 * truth


def test_equal_weights_are_a_count() -> None:
    x = np.random.default_rng(1).normal(size=1000)
    (below, above) = tail_from_weights(x, np.full(1000, 7.0), -2.0, 2.0)
    known = stats.binomtest(int(np.sum(x > 2)), 1000).proportion_ci(0.95, method="exact")
    assert above.ppm == pytest.approx(1e6 * np.mean(x > 2))
    assert above.interval == pytest.approx((1e6 * known.low, 1e6 * known.high), rel=1e-9)
    assert below.effective == pytest.approx(1000)


def test_no_weighted_reject_leaves_the_bound_of_the_effective_number() -> None:
    (tail,) = tail_from_weights(*drawn(np.random.default_rng(3), 20_000), -9.0, None)
    assert tail.ppm == 0
    assert tail.interval[1] == pytest.approx(1e6 * (1 - 0.025 ** (1 / tail.effective)))
    assert "No sample beyond" in tail.note


def test_degenerate_weights_are_refused() -> None:
    x = np.random.default_rng(1).normal(size=5000)
    (tail,) = tail_from_weights(x, np.exp(6 * x), None, 4.0)
    assert tail.ppm is None
    assert "draw new samples" in tail.note
    (nothing,) = tail_from_weights([1.0], [0.0], None, 4.0)
    assert nothing.ppm is None


@pytest.mark.parametrize(
    ("weights", "said"), [([1.0], "1 weights for 2 values"), ([-1.0, 1.0], "negative"), ([np.nan, 1.0], "finite")]
)
def test_wrong_weights_are_named(weights, said: str) -> None:
    with pytest.raises(ReportError, match=said):
        tail_from_weights([1.0, 2.0], weights, None, 1.0)
