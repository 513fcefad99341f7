"""The outcome in a sentence: failures lead where they decide."""

from dataclasses import replace

import pytest

from reporting.render.html import render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table, drawn_by


def test_too_many_failures_leave_no_verdict_on_any_response() -> None:
    """Nine of 20 samples failed: the others say capable, and the failed ones may be the rejects."""
    a = analysis_of(c60_table(100, 45), c60_spec(100))
    assert {r.verdict.word for r in a.responses} == {"no verdict", "no limits"}
    assert a.headline.startswith("No verdict: 45 of 100 samples failed (45\u00a0%: 15 invalid, 15 not_converged, 15 ")
    assert a.headline in render_html(a)


def test_the_share_that_a_verdict_takes_can_be_stated() -> None:
    """With half of the samples enough, each verdict stands, and none is certain that failures could change."""
    a = analysis_of(c60_table(100, 45), replace(c60_spec(100), min_ok=0.5))
    assert "no verdict" not in {r.verdict.word for r in a.responses}
    assert a.headline.startswith("45 of 100 samples failed (45\u00a0%")
    assert "if they were rejects, the verdict on FC-1, " in a.headline
    assert not any(r.verdict.certain for r in a.responses if r.verdict.word != "not capable")
    strict = analysis_of(c60_table(100, 1), replace(c60_spec(100), min_ok=1.0))
    assert strict.headline.startswith("No verdict: 1 of 100 samples failed (1\u00a0%: 1 ")


@pytest.mark.slow
def test_few_failures_lead_only_where_they_could_change_a_verdict() -> None:
    """One failure of 2,000 changes nothing; three of 300 would make capable responses not capable."""
    one = analysis_of(c60_table(2000, 1), c60_spec(2000))
    assert one.headline.startswith("Not capable: FC-4.")
    three = analysis_of(c60_table(300, 3), c60_spec(300))
    assert three.headline.startswith("3 of 300 samples failed (1\u00a0%: ")


def test_without_a_success_or_a_sample_there_is_nothing_to_judge() -> None:
    failed = analysis_of(c60_table(5, 5), c60_spec(5)).headline
    assert failed.startswith("All 5 samples failed (2 ")
    assert failed.endswith("so there is nothing to judge.")
    assert analysis_of(c60_table(5)[:0], c60_spec(5)).headline.startswith("No sample is computed yet")


def test_a_corner_without_a_value_leads() -> None:
    """It may be the worst one."""
    a = analysis_of(c60_table(129, 1), replace(c60_spec(129), **drawn_by("worst_case")))
    assert a.headline.startswith("1 of 129 samples failed (0.78\u00a0%: 1 ")
    assert "Worst case: 0 of 6 responses" in a.headline
