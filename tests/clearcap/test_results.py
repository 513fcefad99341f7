"""The results of a campaign as tables of pandas."""

import dataclasses
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from campaign.errors import SpecError
from campaign.spec.load import load_campaign
from clearcap.questions.report import advice_of, analysis
from clearcap.results import Results, open_campaign, report
from reporting.render.data_files import render_json
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed


@pytest.fixture
def results(tmp_path):
    """Return the results of a campaign of 25 runs by the stand-in, of which some fail."""
    campaign = load_campaign(tomllib.loads(SPEC))
    return Results(*computed(tmp_path / "runs", campaign, 10, fake_engine.simulate))


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Return the results of 400 runs, enough for every number."""
    campaign = load_campaign(tomllib.loads(SPEC), samples=400)
    return Results(*computed(tmp_path_factory.mktemp("many") / "runs", campaign, 400, fake_engine.simulate))


def test_rows(results):
    """All columns of the store, the sample number as index, units beside."""
    table = results.store.table(results.id)
    assert results.rows.index.tolist() == table["sample"].to_pylist()
    assert set(results.rows.columns) == set(table.column_names) - {"sample"}
    assert results.rows.attrs["units"] == results.units
    assert set(results.units) >= {*results.variables, *results.responses}
    assert list(results.ok.columns) == [*results.variables, *results.responses]
    assert len(results.ok) == results.statuses["ok"]


def test_rows_as_xarray(results):
    """Each column over the sample numbers, with its unit; what is missing is NaN, as in the rows."""
    xr = pytest.importorskip("xarray")
    found = results.to_xarray()
    assert (found.sizes, found.attrs["campaign"]) == ({"sample": 25}, results.id)
    assert found.sample.values.tolist() == results.rows.index.tolist()
    for name, column in results.rows.items():
        pd.testing.assert_series_equal(found[name].to_series(), column, check_names=False, check_dtype=False)
        assert found[name].attrs.get("units") == results.units.get(name)
    titles = {name: each.title for name, each in results.plan.mechanism.responses.items() if each.title}
    assert titles
    assert {name: found[name].attrs["long_name"] for name in titles} == titles
    assert float(found["FC-1"].where(found.status == "ok").mean()) == pytest.approx(results.ok["FC-1"].mean())
    assert isinstance(found, xr.Dataset)


def test_without_xarray(results, monkeypatch):
    """The message says what to install."""
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(SpecError, match=r"clearcap\[xarray\]"):
        results.to_xarray()


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


def test_the_questions_of_the_command(many, tmp_path):
    """Each table has the numbers of the function that command and service ask, too."""
    advised, found = many.advise(), advice_of(many.store, many.plan)
    growth = advised.xs("", level="lifts")
    assert growth["factor"].tolist() == [each.factor for each in found.growth]
    assert growth["factor_low"].tolist() == [each.interval[0] for each in found.growth]
    assert len(growth) == 2
    assert advised.attrs["note"] == found.note
    costs = {"variables": {"J1": {"cost": 0.05}}}
    (tmp_path / "costs.toml").write_text("[variables.J1]\ncost = 0.05\n")
    allocated = many.allocate(costs)
    assert allocated == many.allocate(tmp_path / "costs.toml")
    assert repr(allocated).startswith(f"<Allocation: J1 x {allocated.factors['J1']:.4g}; cost ")
    assert len(repr(allocated)) < 200
    with pytest.raises(SpecError, match=r"costs: variables\.J9"):
        many.allocate({"variables": {"J9": {"cost": 1.0}}})
    sensitivity = many.sensitivity
    assert sensitivity.index.names == ["response", "variable"]
    assert 0.9 < sensitivity.loc["FC-1", "share"].sum() < 1.1  # the stand-in is linear
    assert {"first_order_interval_low", "verdict"} <= set(sensitivity.columns)


def test_compared_with_another_campaign(results, tmp_path):
    """A campaign of another seed and store: differences of the means, as the report has them."""
    other = load_campaign(tomllib.loads(SPEC), seed=8)
    there = Results(*computed(tmp_path / "there", other, 10, fake_engine.simulate))
    table = results.compare(there)
    assert list(table.index) == results.responses
    means = results.ok[results.responses].mean() - there.ok[results.responses].mean()
    assert table["mean_difference"].to_numpy() == pytest.approx(means.to_numpy())
    assert (table["mean_interval_low"] < table["mean_difference"]).all()
    assert table.attrs["plans"].values.tolist() == [["seed", 7, 8, True]]


def test_pooled_with_another_seed(results, tmp_path):
    """Rows of both under their ids, numbers of all, a report; not with itself."""
    other = load_campaign(tomllib.loads(SPEC), seed=8)
    there = Results(*computed(tmp_path / "there", other, 10, fake_engine.simulate))
    both = results.pool(there)
    assert both.rows.loc[there.id].equals(there.rows)
    assert both.rows.attrs["units"] == results.units
    assert both.capability.loc["FC-1", "n"] == len(results.ok) + len(there.ok)
    assert Path(both.report("json")["json"]).parent == tmp_path / "runs" / results.id / "pooled" / there.id
    assert repr(both) == f"<PooledResults {results.id} (25 samples), {there.id} (25 samples)>"
    assert there.id in both._repr_html_()
    with pytest.raises(SpecError, match="seed = 7"):
        results.pool(results)


def test_an_aimed_campaign_loads(results):
    """It is of the same mechanism, also where no file has it."""
    aimed = load_campaign(results.design(500, ["FC-1"]))
    assert (aimed.spec.samples, aimed.spec.sampler, aimed.spec.mechanism) == (500, "importance", "c60")
    inline = tomllib.loads(SPEC) | {"mechanism": results.plan.mechanism}
    plan = dataclasses.replace(results.plan, spec=load_campaign(inline).spec)
    assert load_campaign(Results(results.store, plan).design(500)).mechanism.digest() == plan.mechanism.digest()


def test_figures_on_axes(many):
    """Bars, points and curves are the numbers of the analysis; limits are named; a wrong name is told."""
    first = analysis(many.store, many.plan).responses[0]
    name, (top, right) = first.spec.name, Figure().subplots(2)
    assert many.plot.histogram(name, top) is top
    stairs = top.patches[0].get_data()
    assert (stairs.values * np.diff(stairs.edges)).sum() == pytest.approx(1.0)
    assert {text.get_text() for text in top.texts} == {"LSL 9", "USL 16"}
    many.plot.causes(name, right)
    shares = [each.share for each in first.sensitivity.ranked]
    assert [bar.get_width() for bar in right.patches] == pytest.approx([100 * share for share in shares])
    left, below = Figure().subplots(2)
    many.plot.probability(name, left)
    assert left.lines[0].get_xdata().tolist() == list(first.plot.values)
    many.plot.convergence(name, below)
    assert below.lines[0].get_ydata()[-1] == pytest.approx(first.capability.cpk)
    with pytest.raises(SpecError, match="did you mean 'FC-1'"):
        many.plot.causes("FC1")


def test_in_a_line(results):
    """What a prompt shows is no list of batches."""
    assert repr(results) == f"<Results {results.id}: 25 samples in {results.store.url}>"


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
