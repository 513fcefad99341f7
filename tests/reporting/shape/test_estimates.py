"""What the methods without the normal distribution say, in the scale of Cpk and as the share out of limits."""

import math
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from reporting.analysis import Analysis
from reporting.capability.verdict import index_of_share
from reporting.render.html import render_html
from reporting.shape.estimates import index_estimates
from reporting.shape.fitting import fit_families, unfitted
from reporting.shape.pareto import TailShare
from reporting.shape.supported_indices import supported_indices
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def tail(side: str, ppm: float | None, interval: tuple[float, float] | None) -> TailShare:
    return TailShare(side, 1.0, ppm, interval)


def by_tails(*tails: TailShare):
    """Return the estimate of Pareto tails, of 1,000 values."""
    return index_estimates(1000, unfitted("none"), (), tails)


def test_tails_are_as_good_as_the_worse_side() -> None:
    """A far limit on one side says nothing of a near one on the other."""
    (found,) = by_tails(tail("below", 300.0, (50.0, 900.0)), tail("above", None, (0.0, 12.0)))
    assert (found.low, found.value, found.high) == tuple(map(index_of_share, (900.0, 300.0, 50.0)))
    assert found.note == "300 ppm (50.0 to 900) below the limit by a Pareto tail"
    (bound,) = by_tails(tail("above", None, (0.0, 12.0)))
    assert (bound.low, bound.value, bound.high) == (index_of_share(12.0), math.inf, math.inf)
    assert bound.note == "at most 12.0 ppm above the limit by a Pareto tail"


def test_a_side_without_a_fitted_tail_may_be_any_worse() -> None:
    (found,) = by_tails(tail("below", 2.0, (0.1, 20.0)), tail("above", None, None))
    assert (found.low, found.value) == (-math.inf, index_of_share(2.0))
    assert by_tails(tail("above", None, None)) == ()


def test_a_normal_fit_speaks_with_the_interval_of_all_families() -> None:
    """500 normal values with Cpk 1.6 allow distributions with more than 33 ppm beyond the limit."""
    x = np.random.default_rng(2).normal(size=500)
    fits = fit_families(x, limits=(None, 4.8))
    assert fits.best == "normal"
    found = index_estimates(500, fits, supported_indices(x, fits, None, 4.8), ())[1]
    assert found.low < 1.33 < found.value == pytest.approx(1.6, abs=0.1)
    assert "by the distributions that the values allow" in found.note


def test_an_interval_without_an_upper_end_is_said_in_words() -> None:
    """The estimate is as good as any above its lower end; no stand-in is printed as if it had been measured."""
    x = np.random.default_rng(8).normal(size=100)
    fits = fit_families(x, limits=(-9.0, 9.0))
    found = index_estimates(100, fits, supported_indices(x, fits, -9.0, 9.0), ())[1]
    assert found.high == math.inf
    assert f"({found.low:.3f} or more)" in found.note


def test_a_share_too_small_for_an_index_still_counts() -> None:
    """A skewed response 60 sigmas from its lower limit: no Ppk, but at most a tiny share."""
    x = np.random.default_rng(1).gumbel(size=500)
    fits = fit_families(x, limits=(-30.0, None))
    methods = supported_indices(x, fits, -30.0, None)
    assert [method.ppk for method in methods if method.method == "z_score"] == [None]
    (found,) = [e for e in index_estimates(500, fits, methods, ()) if e.method == "fitted distribution"]
    assert found.value == math.inf
    assert found.low > 1.33


@pytest.mark.parametrize(("ppk", "least"), [((1.25, 1.5), 1.25), ((2.9, 4.4), 2.9)])
def test_a_fitted_end_near_the_limit_proves_no_class(ppk: tuple[float, float], least: float) -> None:
    """Of 200 exponential values without a large one Johnson SB had 0 to 0 ppm beyond a limit; 4 700 ppm were true."""
    x = -np.log1p(-0.93 * (np.arange(200) + 0.5) / 200)
    fits = fit_families(x, limits=(None, 5.35))
    assert fits.best == "johnson_sb"
    given = {"percentile": {"ppk_interval": ppk}, "z_score": {"ppm_expected_interval": (0.0, 0.0)}}
    methods = [replace(m, **given.get(m.method, {})) for m in supported_indices(x, fits, None, 5.35)]
    (found,) = [e for e in index_estimates(200, fits, methods, ()) if e.method == "fitted distribution"]
    assert (found.low, found.value) == (least, math.inf)
    assert f"Ppk {ppk[0]:.3f} to {ppk[1]:.3f} by its percentiles" in found.note


def of_values(x: np.ndarray, usl: float) -> Analysis:
    """Return the analysis of a campaign with one response of these values."""
    table, spec = c60_table(x.size), c60_spec(x.size)
    at = table.schema.get_field_index("FC-1")
    response = replace(spec.responses[0], lsl=None, usl=usl)
    return analysis_of(table.set_column(at, "FC-1", pa.array(x)), replace(spec, responses=(response,)))


def test_a_normal_response_has_the_share_of_a_normal_distribution() -> None:
    r = of_values(np.random.default_rng(0).normal(size=500), 4.0).responses[0]
    assert (r.expected.ppm, r.expected.by) == (r.capability.ppm_expected, "normal")


def test_a_skewed_response_has_the_share_of_its_own_distribution() -> None:
    """Exponential values beyond 7: 912 ppm, where the normal distribution with their mean and sigma expects none."""
    a = of_values(np.random.default_rng(3).exponential(size=2000), 7.0)
    r = a.responses[0]
    assert r.capability.ppm_expected < 1
    assert r.capability.cpk > 1.8
    assert r.expected.by not in ("normal", "not normal")
    low, high = r.expected.interval
    assert low < 912 < high
    assert r.verdict.word in ("marginal", "not capable")
    page = " ".join(render_html(a).split())
    assert f'<small class="words">{r.expected.by}</small>' in page
    assert "by the fitted distribution" in page
