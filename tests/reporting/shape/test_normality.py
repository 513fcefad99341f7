"""Normality and the weights of the tails against scipy, published values, and what the verdict may depend on."""

import numpy as np
import pytest
from scipy import stats

from reporting.shape.normality import normality, probability_plot, tail_weights
from reporting.shape.sorted_sample import bin_sample
from tests.each import each


def quantiles(known, n: int) -> np.ndarray:
    """Return the most typical sample of a distribution: its quantiles."""
    return known.ppf((np.arange(1, n + 1) - 0.5) / n)


def test_published_shapiro() -> None:
    """Sets A and B: R's shapiro.test prints these."""
    assert normality(10 + 0.5 * quantiles(stats.norm, 50)).shapiro_w == pytest.approx(0.99920356838, abs=5e-11)
    b = normality(np.exp(1.9 + 0.25 * quantiles(stats.norm, 60)))
    assert b.shapiro_w == pytest.approx(0.97374667693, abs=5e-11)
    assert b.shapiro_p == pytest.approx(0.22168352783, abs=5e-10)


@pytest.mark.parametrize("n", [10, 200, 5000])
def test_statistics_are_scipys(n: int) -> None:
    x = np.random.default_rng(n).gamma(9.0, size=n)
    found, z = normality(x), (x - x.mean()) / x.std(ddof=1)
    known = stats.anderson(x, method="interpolate")
    assert found.anderson_darling == pytest.approx(known.statistic, rel=1e-9)
    assert found.distance == pytest.approx(stats.kstest(z, "norm").statistic, rel=1e-9)
    assert found.skewness == pytest.approx(stats.skew(x, bias=False), rel=1e-9)
    assert found.kurtosis == pytest.approx(stats.kurtosis(x, bias=False), rel=1e-9)
    assert (found.shapiro_w is None) == (n > 5000)


def test_the_p_value_of_anderson_darling_is_a_share_of_normal_samples() -> None:
    """Of 1,500 normal samples of 40, the share with p up to 1, 5, 20, 50 and 80 %; three standard errors."""
    draws = np.random.default_rng(0).normal(size=(1500, 40))
    p = np.array([normality(x).anderson_darling_p for x in draws])
    for level in (0.01, 0.05, 0.2, 0.5, 0.8):
        assert np.mean(p <= level) == pytest.approx(level, abs=3 * np.sqrt(level * (1 - level) / 1500) + 0.005)


@each(
    ("known", "n", "verdict"),
    [
        (stats.norm, 20, "undecided"),
        (stats.norm, 19, "too few values"),
        (stats.norm, 1000, "close to normal"),
        (stats.norm, 30_850, "normal"),
        (stats.skewnorm(1.0), 30_850, "normal"),  # a p-value rejects it: below 1e-10
        (stats.gumbel_r, 30_850, "not normal"),
        (stats.uniform, 30_850, "not normal"),
        (stats.expon, 100, "not normal"),
        (stats.t(4), 30_850, "not normal"),
    ],
)
def test_the_verdict_is_about_size_and_proof(known, n: int, verdict: str) -> None:
    found = normality(quantiles(known, n))
    assert found.verdict == verdict, found.reason
    assert "%" in found.reason


@pytest.mark.slow
def test_a_departure_nobody_minds_stays_normal_however_many_values() -> None:
    """A skew normal whose shares are off by 0.7 %: a million values make the p-value 0 and leave the verdict."""
    for n in (30_000, 1_000_000):
        found = normality(quantiles(stats.skewnorm(1.0), n))
        assert found.verdict == "normal"
    assert found.anderson_darling_p < 1e-10


@pytest.mark.slow
def test_intervals_of_shape_cover_the_truth() -> None:
    """500 samples of 2,000 gamma(16) values, skewness 0.5 and excess 0.375; three standard errors are 0.029.

    The skew of the estimates themselves costs a little more at this n.
    """
    inside = np.zeros(3)
    for i in range(500):
        x = np.random.default_rng(i).gamma(16.0, size=2000)
        found = normality(x)
        known = stats.norm(x.mean(), x.std(ddof=1))
        grid = np.linspace(4, 40, 400)
        true_distance = np.max(np.abs(stats.gamma(16).cdf(grid) - known.cdf(grid)))
        truths = (0.5, 0.375, true_distance)
        ends = (found.skewness_interval, found.kurtosis_interval, found.distance_interval)
        inside += [low <= true <= high for true, (low, high) in zip(truths, ends, strict=True)]
    assert inside[0] / 500 == pytest.approx(0.95, abs=0.04)
    assert inside[1] / 500 == pytest.approx(0.93, abs=0.05)
    assert inside[2] / 500 >= 0.95


def test_a_probability_plot_of_few_values_shows_all() -> None:
    x = 10 + 0.5 * quantiles(stats.norm, 50)
    plot = probability_plot(x[::-1])
    assert plot.values == tuple(np.sort(x))
    assert plot.scores == pytest.approx(stats.norm.ppf((np.arange(1, 51) - 0.3) / 50.4))
    assert all(low < value < high for low, value, high in zip(plot.low, plot.values, plot.high, strict=True))


def test_a_probability_plot_of_many_values_keeps_the_tails() -> None:
    x = np.sort(np.random.default_rng(1).normal(size=50_000))
    plot = probability_plot(x)
    assert len(plot.values) <= 300
    assert plot.values[:100] == tuple(x[:100])
    assert plot.values[-100:] == tuple(x[-100:])
    assert list(plot.scores) == sorted(plot.scores)
    assert plot.low[0] < plot.low[150] < plot.high[150] < plot.high[-1]


def test_the_band_holds_an_ordered_value_as_often_as_it_says() -> None:
    """The fifth smallest of 200 known-normal values lies in its band in 95 % of 1,000 samples, or a little more.

    The band moves with the sample's own mean and sigma, which takes some of the scatter away.
    """
    inside = 0
    for x in np.random.default_rng(3).normal(size=(1000, 200)):
        plot = probability_plot(x)
        inside += plot.low[4] <= plot.values[4] <= plot.high[4]
    assert 0.94 <= inside / 1000 <= 1.0


@pytest.mark.parametrize("x", [[], [1.0], [1.0, 2.0], [3.0] * 9, [np.nan] * 4, [1.0, 1.0, 2.0], [1e300, -1e300, 0.0]])
def test_odd_values_give_no_error(x) -> None:
    found = normality(x)
    assert found.verdict == "too few values"
    assert found.reason
    for value in vars(found).values():
        assert not isinstance(value, float) or np.isfinite(value)
    probability_plot(x)


def weights(x):
    z = np.sort((x - x.mean()) / x.std(ddof=1))
    return tail_weights(bin_sample(z, 20_000), x.size)


@pytest.mark.parametrize(
    ("known", "below", "above"),
    [
        (stats.norm, "like normal", "like normal"),
        (stats.uniform, "lighter", "lighter"),
        (stats.t(6), "heavier", "heavier"),
        (stats.gamma(16), "lighter", "heavier"),
        (stats.gumbel_l, "heavier", "lighter"),
    ],
)
def test_known_distributions(known, below: str, above: str) -> None:
    low, high = weights(known.ppf((np.arange(4_000) + 0.5) / 4_000))
    assert (low.side, low.word, high.side, high.word) == ("below", below, "above", above)


def test_the_weight_of_a_uniform_tail() -> None:
    """E z^4 is 9/5 for a uniform distribution of variance 1, 3 for a normal one."""
    low, high = weights(np.linspace(-1, 1, 2_001))
    assert (low.weight, high.weight) == pytest.approx((0.6, 0.6), rel=2e-3)


@pytest.mark.parametrize("n", [50, 500])
def test_p_is_a_share_of_normal_samples(n: int) -> None:
    """Of 2,000 normal samples, two tails each; the formula holds to a third at 1 %."""
    p = np.array([[tail.p for tail in weights(x)] for x in np.random.default_rng(n).normal(size=(2_000, n))])
    for level, most in ((0.01, 0.016), (0.05, 0.062), (0.2, 0.23)):
        assert np.mean(p <= level) <= most


def test_few_values_have_no_weight() -> None:
    assert weights(np.arange(49.0)) == ()
