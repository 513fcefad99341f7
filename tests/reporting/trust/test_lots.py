"""The trust card, the verdict and the page of a campaign whose samples come in production lots."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from reporting.render.html import render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table

TOO_GOOD = "as the intervals assume"


def analysed(lots: int, size: int = 50, ratio: float = 1.0, failures: int = 0):
    """Return the analysis of lots of equal size; FC-1 shares a shift within a lot, the other responses do not."""
    n = lots * size
    rng = np.random.default_rng(14)
    x = 13.0 + 0.4 * (rng.normal(size=n) + ratio * np.repeat(rng.normal(size=lots), size))
    table = c60_table(n, failures)
    x[n - failures :] = np.nan
    table = table.set_column(table.schema.get_field_index("FC-1"), "FC-1", pa.array(x, from_pandas=True))
    table = table.append_column("lot", pa.array(np.arange(n) // size))
    return analysis_of(table, replace(c60_spec(n), production_batch_column="lot"))


def line(analysis, name: str):
    """Return a line of the trust card."""
    return next(check for check in analysis.trust if check.name == name)


@pytest.mark.slow
def test_many_lots_are_named_and_independence_is_not_claimed() -> None:
    analysis = analysed(40)
    assert TOO_GOOD not in line(analysis, "Sampling").text
    assert "share a shift" in line(analysis, "Production lots").text
    assert line(analysis, "Production lots").level == "info"
    assert "production lots would give" in line(analysis, "Enough samples").text
    first = analysis.responses[0].capability
    assert first.interval_method == "production lots"
    assert first.lots.effective < 0.1 * first.n
    page = render_html(analysis)
    assert "differences between 40 lots" in page
    assert "Effective sample size" in page


def test_without_lots_nothing_is_said_of_them() -> None:
    analysis = analysis_of(c60_table(300), c60_spec(300))
    assert "Production lots" not in [check.name for check in analysis.trust]
    assert TOO_GOOD in line(analysis, "Sampling").text


@pytest.mark.slow
def test_two_lots_make_no_verdict_certain() -> None:
    """590 runs of two lots were called capable, certain, with Cpk 1.519; the true one was 1.320."""
    analysis = analysed(2, size=295, ratio=0.3)
    for r in analysis.responses:
        if r.capability.cpk is not None:
            assert r.capability.cpk_interval is None
            assert r.verdict.certain is False
            assert any("intervals need 5" in reason for reason in r.verdict.reasons)
    assert line(analysis, "Enough samples").level == "attention"
    assert "2 production lots" in line(analysis, "Enough samples").text
    assert line(analysis, "Production lots").level == "attention"


@pytest.mark.slow
def test_methods_for_independent_values_have_no_interval_with_lots() -> None:
    first = analysed(20).responses[0]
    assert all(method.ppk_interval is None for method in first.methods)
    assert all(tail.interval is None for tail in first.tails)
    assert any("treat the values of a production lot as independent" in note for m in first.methods for note in m.notes)
    assert first.running.n[0] > 200


@pytest.mark.slow
def test_failed_runs_keep_the_lots_of_the_others() -> None:
    analysis = analysed(10, failures=3)
    first = analysis.responses[0]
    assert first.capability.lots.count == 10
    assert first.nonconforming.with_failures.n == 500
    assert first.yield_.lower < first.yield_.share
    assert analysis.product.with_failures.lower < analysis_lower_of_independent(analysis)


def analysis_lower_of_independent(analysis) -> float:
    """Return the lower bound of the yield of the whole product for as many independent samples."""
    from reporting.product_yield import count_yield

    counted = analysis.product.with_failures
    return count_yield(counted.conforming, counted.n, 0.95).lower
