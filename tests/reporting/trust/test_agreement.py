"""The card's lines on verdicts: what contradicts one, and what many of them are worth."""

from dataclasses import replace

from reporting.capability.verdict import CapabilityVerdict
from reporting.trust.agreement import many_statements, verdicts_hold
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def test_the_card_quotes_what_contradicts() -> None:
    responses = analysis_of(c60_table(300), c60_spec(300)).responses
    doubt = CapabilityVerdict("marginal", False, "count", ("27 of 30000 values out of limits: marginal at best.",))
    found = verdicts_hold((replace(responses[0], verdict=doubt), *responses[1:]))
    assert found.level == "attention"
    assert "FC-1 (marginal, not certain): 27 of 30000 values out of limits: marginal at best." in found.text


def test_many_statements_are_counted() -> None:
    """Six verdicts and seven responses by seven variables: of 55 statements at 95 %, 2.8 miss by chance."""
    responses = analysis_of(c60_table(300), c60_spec(300)).responses
    found = many_statements(responses, 0.95)
    assert found.value == (6 + 49) * (1 - 0.95)
    assert "6 verdicts and 49 shares of variables are each stated at 95 % confidence on their own" in found.text
    assert "about 2.8 of these 55 may be wrong by chance" in found.text


def test_a_verdict_at_the_edge_does_not_hold_together_with_others() -> None:
    """An interval that keeps its class at 95 %, but not at Bonferroni's 99.2 % for six verdicts."""
    responses = analysis_of(c60_table(300), c60_spec(300)).responses
    edge = replace(responses[0].capability, cpk=1.45, cpk_interval=(1.34, 1.56))
    sure = CapabilityVerdict("capable", True, "index")
    some = (replace(responses[0], capability=edge, verdict=sure), *(replace(r, verdict=sure) for r in responses[1:2]))
    text = many_statements((*some, *responses[2:]), 0.95).text
    assert "(Bonferroni): FC-2" in text
