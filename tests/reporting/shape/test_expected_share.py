"""The share of the page's first table: where a response is not normal, no normal distribution stands for it."""

from dataclasses import replace

import numpy as np
import pyarrow as pa

from reporting.analysis import Analysis
from reporting.render.html import render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


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
    assert f"<small>{r.expected.by}</small>" in page
    assert ", not normal" in page
