"""Questions to samples without new runs, and the verbs that ask them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from campaign.cli import app
from campaign.errors import CampaignError, SpecError
from campaign.plan import make_plan
from campaign.reports.tolerances import advice_of
from campaign.reports.whatif import what_if
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from tests.campaign import fake_engine
from tests.campaign.driving import computed


@pytest.fixture
def filled(campaign, tmp_path):
    """Return a store and a plan of 400 samples with rows of the fake engine."""
    plan = make_plan(replace(campaign, spec=campaign.spec.model_copy(update={"samples": 400})), 200)
    store = open_store(str(tmp_path / "runs"))
    store.create_plan(plan)
    for batch in range(len(plan.batches)):
        run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(batch))
    return store, plan


def test_samples_of_no_distribution_are_not_weighted(filled):
    """Corners, grids and lists are refused before a row is read."""
    store, plan = filled
    corners = replace(plan, spec=plan.spec.model_copy(update={"sampler": "worst_case"}))
    with pytest.raises(SpecError, match="do not follow distributions"):
        what_if(store, corners, ["J1.std=0.01"])
    with pytest.raises(SpecError, match="do not follow distributions"):
        advice_of(store, corners)


def test_a_campaign_without_rows_is_one_message(store, plan):
    """Nothing done, nothing to ask."""
    with pytest.raises(CampaignError, match="no sample is computed yet"):
        what_if(store, plan, ["J1.std=0.01"])


def test_the_verbs_say_it_in_json_and_in_words(filled):
    """Whatif and advise of one campaign, and of an impossible question exit status 1."""
    store, plan = filled
    run = CliRunner()
    place = ["--store", store.url]
    answered = run.invoke(app, ["whatif", plan.campaign_id, "--set", "J1.std=0.016", "--json", *place])
    content = json.loads(answered.stdout)
    assert set(content["responses"]) == set(plan.mechanism.responses)
    assert content["set"] == ["J1.std=0.016"]
    assert "FC-1" in run.invoke(app, ["whatif", plan.campaign_id, "--set", "J1.std=0.016", *place]).stdout
    refused = run.invoke(app, ["whatif", plan.campaign_id, "--set", "J1.std=0.0001", "--json", *place])
    assert refused.exit_code == 1
    assert json.loads(refused.stdout)["responses"]["FC-1"]["refusal"]
    assert isinstance(run.invoke(app, ["whatif", plan.campaign_id, *place]).exception, SpecError)
    advised = json.loads(run.invoke(app, ["advise", plan.campaign_id, "--json", *place]).stdout)
    assert [each["variable"] for each in advised["advice"]] == ["J1", "preload"]
    assert advised["below"] == {}


def test_production_batches_are_minded(campaign_file, tmp_path):
    """Samples that share a shift are worth fewer than independent ones; those of four lots give no interval."""
    path, text = campaign_file.parent / "batches.toml", campaign_file.read_text()
    intervals = {}
    for size in (20, 100):
        path.write_text(text.replace("std = 0.0175", f"std = 0.0175\nbatch = {{size = {size}, std = 0.01}}"))
        store, plan = computed(tmp_path / f"s{size}", load_campaign(str(path), samples=400), 200)
        intervals[size] = what_if(store, plan, ["J1.std=0.0173"])["FC-2"]
    y = store.table(plan.campaign_id)["FC-2"].to_numpy()
    assert np.diff(intervals[20].mean.interval)[0] > 1.2 * 4 * y.std() / 20
    assert "worth 4 production lots" in intervals[100].refusal
    asked = ["whatif", plan.campaign_id, "--set", "J1.std=0.0173", "--store", store.url]
    assert "worth 4 production lots" in CliRunner().invoke(app, asked).stderr


def test_a_share_below_one_sample_is_a_bound(filled):
    """Without a reject the command prints what the samples prove, and no 0."""
    store, plan = filled
    answer = what_if(store, plan, ["J1.std=0.017"])["FC-1"]
    assert answer.ppm.value * answer.effective < 1e6
    shown = CliRunner().invoke(app, ["whatif", plan.campaign_id, "--set", "J1.std=0.017", "--store", store.url]).stdout
    assert "at most" in shown


def test_two_campaigns_are_compared_on_one_page(filled, campaign_file):
    """Report --against names the other campaign on the page and in the JSON."""
    store, plan = filled
    campaign_file.write_text(campaign_file.read_text().replace("seed = 7", "seed = 8"))
    other = make_plan(load_campaign(str(campaign_file)), 25)
    store.create_plan(other)
    run_batch(CampaignAddress.of(store, other, fake_engine.simulate), BatchRequest(0))
    words = ["report", plan.campaign_id, "--against", other.campaign_id, "--no-excel", "--json", "--store", store.url]
    files = json.loads(CliRunner().invoke(app, words).stdout)["report"]
    assert set(files) == {"html", "json", "parquet"}
    content = json.loads(Path(files["json"]).read_text(encoding="utf-8"))
    assert content["comparison"]["campaign"] == other.campaign_id
    assert content["comparison"]["samples"] == 25
    assert content["replay"] == f"clearcap replay --store {store.url} {plan.campaign_id}"
