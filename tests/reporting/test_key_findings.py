"""The five sentences: each says the number of its section, and none is said without a verdict."""

from dataclasses import replace

import pytest

from reporting import format_numbers
from reporting.key_findings import first_sentence, key_findings, short_form, weakest
from reporting.trust.checks import Check
from tests.reporting.render.test_files import fullest_analysis
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def said(analysis) -> dict[str, str]:
    return {each.about: each.text for each in key_findings(analysis)}


def test_they_say_the_numbers_of_their_sections() -> None:
    a = analysis_of(c60_table(200), c60_spec(200))
    found, worst = said(a), weakest(a)
    assert list(found) == ["Worst", "Yield", "Causes", "Trust"]  # no rescaling is given, so no advice
    assert found["Worst"].startswith(f"{worst.spec.name}, Cpk {format_numbers.index(worst.index)} (")
    assert "required 1.33" in found["Worst"]
    assert format_numbers.percent(a.product.counted.share) in found["Yield"]
    strongest = worst.sensitivity.ranked[0]
    assert f"{strongest.variable} ({format_numbers.part(strongest.share)} of its variance)" in found["Causes"]


def test_worst_is_farthest_below_its_own_requirement() -> None:
    """A Cpk of 1.7 where 2 is required is worse than 1.5 where 1.33 is."""
    spec = c60_spec(200)
    strict = replace(spec.responses[0], requirement=3.0)
    a = analysis_of(c60_table(200), replace(spec, responses=(strict, spec.responses[1])))
    assert weakest(a).spec.name == "FC-1"
    assert "required 3" in said(a)["Worst"]


def test_without_a_verdict_no_index_is_quoted() -> None:
    assert "Worst" not in said(analysis_of(c60_table(60, 40), c60_spec(60)))
    assert said(analysis_of(c60_table(60, 60), c60_spec(60)))["Trust"].startswith("Do not rely on these numbers.")


def test_failed_samples_are_rejects_of_the_yield() -> None:
    found = said(analysis_of(c60_table(1000, 2), c60_spec(1000)))
    assert "failed samples counted as rejects" in found["Yield"]


def test_trust_is_as_good_as_its_worst_check() -> None:
    a = analysis_of(c60_table(60), c60_spec(60))
    good, open_, bad = Check("A", "good", "Fine."), Check("B", "attention", "So so. More."), Check("C", "bad", "No.")
    for trust, level, words in (
        ((good,), "good", "Nothing speaks against these numbers: 1 check is good."),
        ((good, open_), "attention", "Read with care: B asks for attention. So so."),
        ((good, open_, bad), "bad", "Do not rely on these numbers. C: No."),
    ):
        found = key_findings(replace(a, trust=trust))[-1]
        assert (found.level, found.text) == (level, words)


def test_what_may_grow_and_what_must_shrink_is_named() -> None:
    text = said(fullest_analysis()).get("Tolerances", "")
    assert text == "" or "Cpk 1.33" in text


@pytest.mark.parametrize(
    ("text", "first"),
    [
        ("Largest 3.2e-9, sample 7. More here.", "Largest 3.2e-9, sample 7."),
        ("By ISO 22514-2, 1.33 is enough.", "By ISO 22514-2, 1.33 is enough."),
        ("Is it so? It is.", "Is it so?"),
    ],
)
def test_the_first_sentence_ends_at_its_own_point(text, first) -> None:
    assert first_sentence(text) == first


def test_a_long_finding_is_cut_at_a_clause_without_dots() -> None:
    effect = "the ppm that a normal distribution predicts below the limit is too small"
    text = f"FC-1 is not normal (Anderson-Darling p < 0.0001, and so on, and on): {effect}; {'and more ' * 20}. More."
    assert short_form(text) == f"FC-1 is not normal: {effect}."
    assert short_form(f"It drifts: {'and more ' * 20}.") == "It drifts."
    assert short_form("All is well. More.") == "All is well."
