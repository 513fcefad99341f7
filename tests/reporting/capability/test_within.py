"""Sigma within batches against published numbers, a simulation and the analysis of variance."""

import numpy as np
import pytest
from scipy import stats

from reporting import ReportError, capability
from reporting.capability.indices import NAMES, WHICH_SIGMA
from reporting.capability.intervals import cpk_interval
from reporting.capability.precision import freedom_of_pooled
from reporting.capability.within import within


def set_c() -> tuple[np.ndarray, np.ndarray]:
    """Return 12 batches of 5 that drift."""
    rows = [
        (20 + 0.1 * ((7 * i) % 11) + 0.05 * ((3 * i * j) % 7) + 0.02 * i, i) for i in range(1, 13) for j in range(1, 6)
    ]
    values, batches = zip(*rows, strict=True)
    return np.array(values), np.array(batches)


def test_set_c_gives_the_published_pooled_sigma() -> None:
    """The drift makes the sigma within 3.5 times as small as the overall one, and so the indices."""
    x, batches = set_c()
    c = capability(x, 19.5, 21.7, batches=batches)
    assert c.within.std == pytest.approx(0.0886237364743, rel=1e-11)
    assert (c.within.batches, c.within.nu) == (12, 48)
    assert c.std == pytest.approx(0.3134102562147, rel=1e-12)
    assert c.within.cp == pytest.approx(2.2 / (6 * 0.0886237364743), rel=1e-11)
    assert c.within.cpk == pytest.approx(c.cpk * c.std / c.within.std, rel=1e-12)
    low, high = c.within.cp_interval
    assert low / c.within.cp == pytest.approx(np.sqrt(stats.chi2.ppf(0.025, 48) / 48), rel=1e-12)
    assert high / c.within.cp == pytest.approx(np.sqrt(stats.chi2.ppf(0.975, 48) / 48), rel=1e-12)


def test_the_sigma_between_is_that_of_the_analysis_of_variance() -> None:
    x, batches = set_c()
    groups = [x[batches == i] for i in range(1, 13)]
    f = stats.f_oneway(*groups).statistic
    c = capability(x, batches=batches)
    assert c.within.std_between == pytest.approx(c.within.std * np.sqrt((f - 1) / 5), rel=1e-10)


@pytest.mark.slow
def test_intervals_within_cover_the_truth() -> None:
    """1,500 campaigns of 12 batches of 5 that agree; three binomial standard errors are 0.017, Bissell one percent."""
    batches = np.repeat(np.arange(12), 5)
    inside = {"cp": 0, "cpk": 0, "cpl": 0, "cpu": 0}
    truth = {"cp": 1.33, "cpk": 1.0, "cpl": 1.0, "cpu": 1.66}
    for x in np.random.default_rng(9).normal(size=(1500, 60)):
        found = capability(x, -3.0, 4.98, batches=batches).within
        for name in inside:
            low, high = getattr(found, f"{name}_interval")
            inside[name] += low <= truth[name] <= high
    for name, count in inside.items():
        assert count / 1500 == pytest.approx(0.95, abs=0.027 if name == "cpk" else 0.017), name


def test_one_batch_is_the_overall_sigma() -> None:
    x, _ = set_c()
    c = capability(x, 19.5, 21.7, batches=np.full(60, "A7"))
    assert c.within.std == pytest.approx(c.std, rel=1e-12)
    assert c.within.std_between is None
    alone = capability(x, 19.5, 21.7)
    assert c.within.cpk_interval == pytest.approx(cpk_interval(alone.cpk, 60, 0.95), rel=1e-12)


def test_batches_do_not_depend_on_order_offset_or_names() -> None:
    x, batches = set_c()
    order = np.random.default_rng(1).permutation(60)
    one = capability(x, 19.5, 21.7, batches=batches).within
    other = capability(x[order] + 1e6, 19.5 + 1e6, 21.7 + 1e6, batches=[f"lot {b}" for b in batches[order]]).within
    assert other.std == pytest.approx(one.std, rel=1e-7)
    assert other.cpk == pytest.approx(one.cpk, rel=1e-7)


def test_values_that_are_missing_take_their_batch_along() -> None:
    x, batches = set_c()
    holes = np.where(batches == 3, np.nan, x)
    kept = batches != 3
    assert capability(holes, batches=batches).within == capability(x[kept], batches=batches[kept]).within


def test_no_batch_with_a_spread_has_no_sigma_within() -> None:
    c = capability([1.0, 2.0, 3.0], 0, 4, batches=[1, 2, 3])
    assert c.within is None
    assert any("No batch has two different values" in note for note in c.notes)
    assert capability([1.0, 1.0, 3.0, 3.0], 0, 4, batches=[1, 1, 2, 2]).within is None


def test_batches_must_be_as_many_as_the_values() -> None:
    with pytest.raises(ReportError, match=r"\b3 values"):
        capability([1.0, 2.0, 3.0], batches=[1, 2])


def test_every_index_has_its_names() -> None:
    """The paper's Cp is AIAG's Pp; which sigma is one sentence, said once."""
    assert (NAMES["cp"].paper, NAMES["cp"].overall, NAMES["cp"].within) == ("Cp", "Pp", "Cp")
    assert (NAMES["cpk"].paper, NAMES["cpk"].overall, NAMES["cpk"].within) == ("Cpk", "Ppk", "Cpk")
    assert "overall" in WHICH_SIGMA


def covered(draw, cp: float, times: int = 300) -> float:
    """Return how often the interval of Cp within 20 lots of 25 holds the truth."""
    rng, batches = np.random.default_rng(14), np.repeat(np.arange(20), 25)
    hits = 0
    for _ in range(times):
        low, high = within(draw(rng, batches), batches, -3.0, 3.0, 0.95).cp_interval
        hits += low <= cp <= high
    return hits / times


def test_intervals_hold_where_lots_differ_in_spread() -> None:
    """Lots of which each has a sigma of its own: chi-square with the freedom of all values covers half of them."""
    scale = 0.6

    def draw(rng, batches):
        return (np.exp(scale * rng.standard_normal(20))[:, None] * rng.standard_normal((20, 25))).ravel()

    assert covered(draw, 1 / np.exp(scale**2)) >= 0.85


def test_intervals_hold_where_values_within_lots_have_heavy_tails() -> None:
    def draw(rng, batches):
        return rng.standard_t(5, 500) / np.sqrt(5 / 3)

    assert covered(draw, 1.0) >= 0.91


@pytest.mark.slow
@pytest.mark.parametrize(("lots", "size"), [(20, 3), (10, 5), (5, 100)])
def test_intervals_hold_for_a_skewed_response(lots, size) -> None:
    """The residuals of small lots look more normal than the values, and five lots tell little of how lots differ."""
    rng, batches, hits = np.random.default_rng(14), np.repeat(np.arange(lots), size), 0
    # Of exp(s w), where half the variance of the normal score w lies between lots.
    inside = np.exp(0.5) - np.exp(0.375)
    for _ in range(400):
        score = rng.standard_normal(lots)[batches] + rng.standard_normal(lots * size)
        low, high = within(np.exp(0.5 * score / 2**0.5) / inside**0.5, batches, -3.0, 3.0, 0.95).cp_interval
        hits += low <= 1.0 <= high
    assert hits / 400 >= 0.9


def test_normal_values_within_lots_keep_their_interval() -> None:
    """Exact, but where chance makes a sample look otherwise, which widens it."""

    def draw(rng, batches):
        return rng.standard_normal(500) + rng.standard_normal(20)[batches]

    assert 0.92 <= covered(draw, 1.0) <= 0.985


def test_a_confidence_of_next_to_nothing_has_degrees_of_freedom_too():
    """Both quantiles behind them round to 0 there; their ratio has a limit."""
    values = np.random.default_rng(0).normal(size=41)
    values -= values.mean()
    small, least = (freedom_of_pooled(values, np.zeros(41, int), confidence) for confidence in (1e-6, 1e-160))
    assert small == least
    assert 1 < least < 40
