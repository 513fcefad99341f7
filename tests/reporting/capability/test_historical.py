"""Values beside the mean and sigma that their process is known to have."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from reporting.capability.summary import capability, historical
from reporting.render.html import render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def test_indices_are_those_of_the_given_mean_and_sigma_and_intervals_those_of_the_differences() -> None:
    x = stats.norm.ppf((np.arange(200) + 0.5) / 200) * 2 + 50
    found = historical(capability(x, 40.0, 62.0), 51.0, 2.5)
    assert found is not None
    assert (found.cp, found.cpk) == (pytest.approx(22 / 15), pytest.approx(11 / 7.5))
    assert found.shift == pytest.approx(-1.0)
    assert found.shift_interval == pytest.approx(
        stats.t.interval(0.95, 199, loc=-1.0, scale=x.std(ddof=1) / np.sqrt(200)), abs=0.02
    )
    assert found.ratio == pytest.approx(x.std(ddof=1) / 2.5)
    assert "mean and the historical sigma" in found.finding
    assert historical(capability(x), 50.0, 2.0).finding == ""


def test_one_limit_no_limit_and_no_spread() -> None:
    x = np.linspace(0.0, 1.0, 40)
    above = historical(capability(x, None, 2.0), 0.5, 0.25)
    assert (above.cp, above.cpk) == (None, pytest.approx(2.0))
    assert historical(capability(x), 0.5, 0.3).cpk is None
    flat = historical(capability(np.full(40, 3.0), 0.0, 6.0), 3.0, 0.5)
    assert (flat.cpk, flat.shift, flat.shift_interval) == (pytest.approx(2.0), 0.0, None)
    assert historical(capability(x), None, 0.3) is None


def test_a_process_that_has_not_changed_is_contradicted_as_often_as_stated() -> None:
    draws = np.random.default_rng(5).normal(10.0, 0.3, (400, 60))
    blamed = sum(bool(historical(capability(x), 10.0, 0.3).finding) for x in draws)
    assert 20 <= blamed <= 60  # two tests at 5 %: 9.75 % of 400, within 3.5 standard errors


def test_the_page_shows_both_and_what_the_values_contradict() -> None:
    table, spec = c60_table(60, 4), c60_spec(60)
    first = replace(spec.responses[0], historical=(13.66, 0.478))
    page = render_html(analysis_of(table, replace(spec, responses=(first, *spec.responses[1:]))))
    assert "Historical mean and σ: Cp, Cpk" in page
    assert "contradict the historical mean" in page
    assert "istorical" not in render_html(analysis_of(table, spec))
