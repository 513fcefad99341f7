"""Tails against known shares; tails that are refused."""

import numpy as np
import pytest
from scipy import stats

from reporting.shape.pareto import MOST_EXCESSES, pareto_tails


@pytest.mark.slow
@pytest.mark.parametrize(("known", "limit"), [(stats.norm(), 4.0), (stats.t(5), 9.0), (stats.lognorm(0.3), 3.4)])
def test_the_tail_of_known_distributions(known, limit: float) -> None:
    """60 campaigns of 20,000: 20 to 140 ppm, a few rejects each; three binomial standard errors are 0.084."""
    rng = np.random.default_rng(8)
    ppm, inside, estimates = 1e6 * known.sf(limit), 0, []
    for _ in range(60):
        tail = pareto_tails(known.rvs(20_000, random_state=rng), None, limit)[0]
        low, high = tail.interval
        inside += low <= ppm <= high
        estimates.append(tail.ppm or 0.0)
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
        (np.random.default_rng(1).random(20_000), 1.01, "fits none of the tails"),
    ],
)
def test_a_tail_that_is_not_valid_is_refused_with_the_reason(x, limit: float, said: str) -> None:
    (tail,) = pareto_tails(x, None, limit)
    assert tail.ppm is None
    assert tail.interval is None
    assert said in tail.note


def test_no_number_and_no_bound_below_a_hundredth_of_one_value() -> None:
    """500 values and a limit far outside gave 0 to 0.001 ppm."""
    (tail,) = pareto_tails(np.random.default_rng(3).normal(size=500), None, 12.0)
    assert tail.ppm is None
    assert tail.interval[0] == 0
    assert tail.interval[1] >= 20
    assert "only an upper bound" in tail.note


def test_a_tail_that_seems_to_end_has_a_bound_that_supposes_no_end() -> None:
    """Before, the bound was 187 ppm, an eighth of the share of an exponential tail with the same mean."""
    p = (np.arange(50) + 0.5) / 50
    values = np.concatenate((np.linspace(-3, 0, 450), (1 - (1 - p) ** 0.45) / 0.45))
    (tail,) = pareto_tails(values, None, 2.95)
    assert tail.shape < -0.3
    assert tail.ppm is None
    assert tail.interval[0] == 0
    assert "ends before the limit, so there is only an upper bound" in tail.note
    exponential = 0.1 * np.exp(-2.95 / values[450:].mean())
    assert 1e6 * exponential < tail.interval[1] < 10e6 * exponential


@pytest.mark.slow
@pytest.mark.parametrize("ppm", [3.4, 230.0])
@pytest.mark.parametrize(
    ("known", "sign"),
    [(stats.norm(), 1), (stats.lognorm(0.5), -1), (stats.t(5), 1), (stats.gumbel_r(), -1), (stats.gamma(16), 1)],
    ids=["normal", "lognormal below", "t5", "Gumbel below", "gamma"],
)
def test_the_interval_covers_at_2000_values(known, sign: int, ppm: float) -> None:
    """25 samples; before, 65 to 91 of 100, with the truth above the upper end in up to 32."""
    limit = known.isf(ppm * 1e-6) if sign > 0 else -known.ppf(ppm * 1e-6)
    rng = np.random.default_rng(5)
    tails = [pareto_tails(sign * known.ppf(rng.random(2000)), None, limit)[0] for _ in range(25)]
    known_ends = [tail.interval for tail in tails if tail.interval]
    assert len(known_ends) >= 22
    assert np.mean([low <= ppm <= high for low, high in known_ends]) >= 0.8
    assert np.mean([ppm > high for _, high in known_ends]) <= 0.12


def test_a_few_values_of_another_kind_are_no_heavy_tail() -> None:
    """1 % of 500 values shifted by 6 sigmas, and 0.2 % of 5,000 by 8; the limit at an index of 1.67 lies beyond all.

    Eight campaigns of each: the interval has the true share, while a true heavy tail keeps its upper end.
    """
    rng = np.random.default_rng(5)
    share = stats.norm.sf(3 * 1.67)
    for part, shift, n in ((0.01, 6.0, 500), (0.002, 8.0, 5000)):
        limit = shift + stats.norm.isf(share / part)
        for _ in range(8):
            x = rng.standard_normal(n) + np.where(rng.random(n) < part, shift, 0.0)
            tail = pareto_tails(x, None, limit)[0]
            assert tail.interval is None or tail.interval[0] <= 1e6 * share <= tail.interval[1]
    heavy = pareto_tails(stats.t(3).rvs(5000, random_state=rng), None, stats.t(3).isf(20e-6))[0]
    assert heavy.interval[1] >= 20
