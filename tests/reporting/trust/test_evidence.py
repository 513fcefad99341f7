"""The card's lines on failures, on the number of samples, and on verdicts: what contradicts one."""

import re
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from reporting.analysis import Analysis
from reporting.capability.verdict import CapabilityVerdict
from reporting.trust.evidence import many_statements, verdicts_hold
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def line(analysis: Analysis, name: str):
    """Return a line of the trust card."""
    return next(check for check in analysis.trust if check.name == name)


@pytest.mark.parametrize(("n", "level"), [(11, "attention"), (29, "attention"), (2000, "good")])
def test_few_values_are_not_enough_whatever_class_their_interval_lies_in(n: int, level: str) -> None:
    """The level agrees with the printed width: 11 values know a Cpk to some +-45 %."""
    table, spec = c60_table(n), c60_spec(n)
    wide = [r for r in spec.responses if r.name in ("FC-2", "FC-3")]
    found = line(analysis_of(table, _with_limits(spec, wide, 2.0)), "Enough samples")
    assert found.level == level
    width = float(re.search(r"Least certain Cpk: FC-[23], ±([\d.]+)", found.text).group(1))
    assert (width <= 25) == (level == "good")
    assert ("too few for a verdict: at least 30 are needed" in found.text) == (n < 30)


def _with_limits(spec, responses, far: float):
    """Return the spec with only these responses, their limits moved so far out that each is capable for sure."""
    moved = tuple(replace(r, lsl=r.lsl - far, usl=r.usl + far) for r in responses)
    return replace(spec, responses=moved)


@pytest.mark.slow
def test_failures_as_rejects_ask_for_attention_with_what_follows() -> None:
    """Three of 300: Cpk 0.77 at best, and 10,000 ppm at least."""
    found = line(analysis_of(c60_table(300, 3), c60_spec(300)), "Failures as rejects")
    assert found.level == "attention"
    shares = [float(text.replace("\u202f", "")) for text in re.findall(r"([\d\u202f]+) ppm instead of", found.text)]
    assert min(shares) >= 10_000
    indices = [float(text) for text in re.findall(r"Cpk (-?[\d.]+) instead of", found.text)]
    assert len(indices) == 3
    assert max(indices) < 0.776
    assert line(analysis_of(c60_table(300), c60_spec(300)), "Failures as rejects").level == "good"


@pytest.mark.slow
@pytest.mark.parametrize(("failed", "level"), [(0, "good"), (2, "attention"), (3, "bad")])
def test_failures_are_bad_where_they_leave_no_verdict(failed: int, level: str) -> None:
    """Two of 200 leave 99 % ok, three do not."""
    found = line(analysis_of(c60_table(200, failed), c60_spec(200)), "Failures")
    assert found.level == level
    assert ("because less than 99\u00a0% of the samples are ok (failures.min_ok)" in found.text) == (level == "bad")


def test_rows_that_drift_are_told_and_those_of_a_campaign_have_no_order() -> None:
    """A table of measured parts is in the order in which they were made; samples that clearcap draws have none."""
    table, spec = c60_table(300), c60_spec(300)
    calm = line(analysis_of(table, spec), "Order of the rows")
    assert calm.level == "good"
    assert "300 values show a correlation of neighbours surely only above" in calm.text
    place = table.schema.get_field_index("FC-2")
    rising = table.set_column(place, table.schema.field(place), pa.array(np.sort(table["FC-2"].to_numpy())))
    found = analysis_of(rising, spec)
    told = line(found, "Order of the rows")
    assert told.level == "attention"
    assert told.text.startswith("FC-2: The values are not in random order (p < 0.0001): they rise from row to row")
    assert "By chance alone this is said of 1 % of stable responses." in told.text
    (response,) = (r for r in found.responses if r.spec.name == "FC-2")
    assert response.verdict.certain is False
    drawn = analysis_of(rising, replace(spec, ordered=False))
    assert not any(check.name == "Order of the rows" for check in drawn.trust)


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
    assert "55 statements at 95 % each (6 verdicts, 49 shares of variables)" in found.text
    assert "expect about 2.8 to be wrong" in found.text


def test_a_verdict_at_the_edge_does_not_hold_together_with_others() -> None:
    """An interval that keeps its class at 95 %, but not at Bonferroni's 99.2 % for six verdicts."""
    responses = analysis_of(c60_table(300), c60_spec(300)).responses
    edge = CapabilityVerdict("capable", True, "index", index=1.45, index_low=1.34, index_high=1.56)
    sure = CapabilityVerdict("capable", True, "index", index=2.0, index_low=1.8, index_high=2.2)
    some = (replace(responses[0], verdict=edge), replace(responses[1], verdict=sure))
    open_ones = [replace(r, verdict=replace(r.verdict, certain=False)) for r in responses[2:]]
    text = many_statements((*some, *open_ones), 0.95).text
    assert "(Bonferroni): FC-2." in text


def test_a_limit_on_the_far_side_of_zero_is_named() -> None:
    """The values of FC-1 lie around 13.7: a lower limit of -9 is a wrong sign; +-20 are deviations from zero."""
    table, spec = c60_table(60), c60_spec(60)
    for lsl, usl, named in ((-9.0, 16.0, True), (9.0, 16.0, False), (0.0, 16.0, False), (-20.0, 20.0, False)):
        moved = replace(spec, responses=(replace(spec.responses[0], lsl=lsl, usl=usl), *spec.responses[1:]))
        texts = [check.text for check in analysis_of(table, moved).trust if check.name == "Limits"]
        assert ["FC-1 lsl = -9" in text for text in texts] == [True] * named, (lsl, usl)
