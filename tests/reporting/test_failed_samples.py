"""What separates failed samples: the variable that makes them fail comes first, on one side or at both ends."""

import re

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import ks_2samp

from reporting.render.html import render_html
from tests.reporting.synthetic import analysis_of, c60_spec, c60_table


def failing(column: str, where) -> pa.Table:
    """Return the table in which the samples fail where their value of a column says so."""
    table = c60_table(60)
    failed = where(table[column].to_numpy())
    status = pa.array(["not_converged" if bad else "ok" for bad in failed])
    return table.set_column(table.schema.get_field_index("status"), "status", status)


def test_a_side_that_fails_is_found() -> None:
    table = failing("J3", lambda x: x > 0.08)
    first = analysis_of(table, c60_spec(60)).failed_against_ok[0]
    x = table["J3"].to_numpy()
    assert first.variable == "J3"
    assert first.distance == pytest.approx(ks_2samp(x[x > 0.08], x[x <= 0.08]).statistic) == 1.0
    assert (first.low_failed, first.high_ok) == (x[x > 0.08].min(), x[x <= 0.08].max())
    assert first.p < 1e-6


def test_both_ends_that_fail_are_found() -> None:
    """Then the means are alike, and the distances from the requested mean differ."""
    table = failing("J5", lambda x: np.abs(x - 0.07) > 0.012)
    first = analysis_of(table, c60_spec(60)).failed_against_ok[0]
    assert (first.variable, first.distance) == ("J5", 1.0)


def test_a_failing_campaign_leads_with_them() -> None:
    """No index of the few that are left is quoted before; with few failures they are in the appendix."""
    page = render_html(analysis_of(failing("J3", lambda x: x > 0.05), c60_spec(60)))
    assert page.index("Failed against ok, by variable") < page.index('id="summary"')
    assert ">Worst</a>" not in page
    assert not re.search(r'data-label="Index"><strong>', page.split('<section class="appendix"')[0])
    assert "()" not in page.split("<body>")[1]
    few = render_html(analysis_of(failing("J3", lambda x: x > 1.0), c60_spec(60)))
    assert "Failed against ok" not in few


def test_without_one_of_the_groups_there_is_nothing_to_compare() -> None:
    assert analysis_of(c60_table(60), c60_spec(60)).failed_against_ok == ()
    assert analysis_of(c60_table(60, 60), c60_spec(60)).failed_against_ok == ()
