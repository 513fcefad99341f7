"""The results of a campaign as tables of pandas."""

import tomllib
from pathlib import Path

import pandas as pd
import pytest

from campaign.errors import SpecError
from campaign.spec.load import load_campaign
from clearcap.questions.report import analysis
from clearcap.results import Results, open_campaign, report
from reporting.render.json import render_json
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed


@pytest.fixture
def results(tmp_path):
    """Return the results of a campaign of 25 runs by the stand-in, of which some fail."""
    campaign = load_campaign(tomllib.loads(SPEC))
    return Results(*computed(tmp_path / "runs", campaign, 10, fake_engine.simulate))


def test_rows(results):
    """All columns of the store, the sample number as index, units beside."""
    table = results.store.table(results.id)
    assert results.rows.index.tolist() == table["sample"].to_pylist()
    assert set(results.rows.columns) == set(table.column_names) - {"sample"}
    assert results.rows.attrs["units"] == results.units
    assert set(results.units) >= {*results.variables, *results.responses}
    assert list(results.ok.columns) == [*results.variables, *results.responses]
    assert len(results.ok) == results.statuses["ok"]


def test_capability_is_that_of_the_report(results, monkeypatch):
    """The table is capability.parquet, and what it rests on is capability.json to the letter, repeats included."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1795305213")
    files = report(results, ("json", "parquet"))
    assert results.capability.equals(pd.read_parquet(files["parquet"]).set_index("response"))
    assert any(response.repeatability for response in analysis(results.store, results.plan).responses)
    assert render_json(analysis(results.store, results.plan)) == Path(files["json"]).read_text("utf-8")


def test_what_if(results):
    """One row a response, with a refusal where there is no number."""
    variable = results.variables[0]
    answer = results.what_if(f"{variable}.std={results.ok[variable].std() * 0.9}")
    assert list(answer.index) == results.responses
    assert {"cpk", "cpk_interval_low", "cpk_interval_high", "refusal"} <= set(answer.columns)
    assert ((answer["mean"].isna()) == (answer["refusal"] != "")).all()


def test_shown_in_a_notebook(results):
    """Title and counts, as text."""
    shown = results._repr_html_()
    assert results.id in shown
    assert f"{results.statuses['ok']} ok" in shown
    assert "<script" not in shown


def test_no_such_campaign(tmp_path):
    """The message names the store."""
    with pytest.raises(SpecError, match="empty"):
        open_campaign("c60-123", store=tmp_path / "empty")
