"""The page claims no more than its runs can show."""

import re
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from scipy.special import ndtri

from reporting.capability.shares import largest_z, least_ppm
from reporting.render.html import render_html
from reporting.shape.estimates import ExpectedShare
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def with_column(name: str, values: np.ndarray, **limits: float | None):
    """Return the analysis of a campaign with one response, of these values and limits."""
    table, spec = c60_table(values.size), c60_spec(values.size)
    at = table.schema.get_field_index("FC-1")
    table = table.set_column(at, "FC-1", pa.array(values))
    response = replace(spec.responses[0], **{"lsl": None, "usl": None, **limits})
    return analysis_of(table, replace(spec, responses=(response,)))


def text_of(page: str) -> str:
    return " ".join(re.sub(r"<[^>]+>", " ", page.split("<main>")[1]).split())


@pytest.fixture(scope="module")
def far():
    """Return a response with limits at seven sigma, 500 runs."""
    return with_column("FC-1", ndtri((np.arange(500) + 0.5) / 500), lsl=-7.0 * 3, usl=7.0 * 3)


def test_no_share_below_what_the_runs_can_show(far) -> None:
    """500 runs show no share below 2 ppm, nor a Z above 4.61: one reject in half a million."""
    assert least_ppm(500) == 2.0
    assert largest_z(500) == pytest.approx(4.6114, abs=1e-4)
    text = text_of(render_html(far))
    assert far.responses[0].capability.sigma_level > 20
    assert "Z.bench > 4.61" in text.replace("&gt;", ">")
    assert "Sigma level (Z.bench + 1.5) > 6.11" in text.replace("&gt;", ">")
    expected = re.search(r"expected, normal (.*?) a normal distribution", text).group(1)
    assert set(re.findall(r"[\d.]+", expected)) == {"2.0"}


def test_a_range_below_what_the_runs_can_show_is_one_bound() -> None:
    """FC-1 of skewed values, with limits far away: the fitted distributions disagree below 2 ppm, which nobody sees."""
    values = np.exp(0.1 * ndtri((np.arange(500) + 0.5) / 500))
    text = text_of(render_html(with_column("FC-1", values, lsl=-9.0, usl=11.0)))
    assert "2.0 to &lt; 2.0" not in text
    assert "2.0 to < 2.0" not in text


@pytest.mark.parametrize(
    ("interval", "printed"), [((0.01, 0.5), "< 2.0 fitted"), ((0.01, 30.0), "< 2.0 to 30.0 fitted")]
)
def test_a_range_in_the_summary_has_one_bound_at_most(far, interval, printed) -> None:
    """The share to expect of several distributions: with both ends below what the runs can show it has one bound."""
    response = replace(far.responses[0], expected=ExpectedShare(None, interval, "fitted distributions"))
    text = text_of(render_html(replace(far, responses=(response,)))).replace("&lt;", "<")
    assert f" {printed} distributions " in text
    assert f"to {printed}" not in text


def test_a_share_that_the_runs_can_show_is_printed() -> None:
    """The 64 ppm of Cpk 1.33 stay a number."""
    a = with_column("FC-1", np.random.default_rng(0).normal(size=500), lsl=-4.0, usl=4.0)
    expected = re.search(r"expected, normal (.*?) a normal distribution", text_of(render_html(a))).group(1)
    assert "&lt;" not in expected.split(" to ")[0]


def test_a_normal_fit_is_not_called_free_of_the_assumption(far) -> None:
    assert far.responses[0].fits.best == "normal"
    text = text_of(render_html(far))
    assert "without assuming a normal distribution" not in text
    assert "percentiles and Z-scores assume it as Cpk does" in text


def test_a_constant_response_is_not_asked_for_more_samples() -> None:
    a = with_column("FC-1", np.full(400, 3.0), lsl=0.0, usl=4.0)
    [enough] = [check for check in a.trust if check.name == "Enough samples"]
    assert "more samples" not in enough.text
    assert a.responses[0].verdict.word == "constant"
    assert 'aria-label="open"' not in render_html(a)


def test_the_headline_leads_with_what_is_bad() -> None:
    """Two values prove nothing, and what is not certain is not counted as capable."""
    a = analysis_of(c60_table(500), c60_spec(500))
    assert a.headline.startswith("Not capable: FC-4. Marginal, not certain: FC-3. Capable, not certain: FC-1, ")
    few = analysis_of(c60_table(2), c60_spec(2))
    assert {r.verdict.word for r in few.responses} == {"no verdict", "no limits"}
    assert "No verdict: FC-1" in few.headline
    assert few.headline.endswith("Certainly capable: none of 6 responses with limits.")


def test_a_normal_distribution_has_values_everywhere() -> None:
    """Limits beyond 38 sigma have a share too small for a number; the normal distribution does not end before them."""
    a = with_column("FC-1", ndtri((np.arange(500) + 0.5) / 500), lsl=-60.0, usl=60.0)
    assert a.responses[0].fits.best == "normal"
    notes = " ".join(note for method in a.responses[0].methods for note in method.notes)
    assert "too small for a number" in notes
    assert "outside the range" not in notes


def test_what_is_true_of_both_tails_is_said_once(far) -> None:
    """Where the tails differ, each note has its side."""
    note = "The limit is too far beyond 500 values for a number, so there is only an upper bound."
    below, above = (replace(tail, note=note) for tail in far.responses[0].tails)
    one_note, two_notes = (
        text_of(render_html(replace(far, responses=(replace(far.responses[0], tails=(below, other)),))))
        for other in (above, replace(above, note="Another reason."))
    )
    assert one_note.count(note) == 1
    assert f"below: {note}" not in one_note
    assert f"below: {note}" in two_notes
    assert "above: Another reason." in two_notes


def test_a_fit_that_rounding_alone_keeps_from_all_of_the_variance_has_no_row_of_nines(far) -> None:
    """A sum of two variables gave 99.9999999999999 %."""
    response = far.responses[0]
    exact = replace(response, stack=replace(response.stack, shape="linear", explained=1 - 1e-14))
    text = text_of(render_html(replace(far, responses=(exact,))))
    assert "a linear fit explains more than 99.99 % of the variance" in text.replace("\u00a0", " ")
