"""Questions to samples without new runs, and the verbs that ask them."""

import json
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from typer.testing import CliRunner

from campaign.errors import CampaignError, SpecError
from campaign.plan import make_plan
from campaign.samples import independent_samples
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from clearcap.cli import app
from clearcap.cli.predictions import _cell
from clearcap.questions.report import advice_of
from clearcap.questions.whatif import share_in_words, what_if, what_if_document, what_if_from
from reporting.format_numbers import ppm
from reporting.tolerance.whatif import Estimate, WhatIf
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
    refused = run.invoke(app, ["whatif", plan.campaign_id, "--set", "preload.upper=1.5", "--json", *place])
    assert refused.exit_code == 1
    assert json.loads(refused.stdout)["responses"]["FC-1"]["refusal"]
    assert isinstance(run.invoke(app, ["whatif", plan.campaign_id, *place]).exception, SpecError)
    advised = json.loads(run.invoke(app, ["advise", plan.campaign_id, "--json", *place]).stdout)
    assert [each["variable"] for each in advised["advice"]] == ["J1", "preload"]
    assert advised["below"] == {}


def test_what_weights_do_not_carry_is_emulated(filled):
    """The rows of the stand-in are linear, so sigma follows from those of the variables; the answer is labelled."""
    store, plan = filled
    words = ["whatif", plan.campaign_id, "--set", "J1.std=0.001", "--store", store.url]
    told = CliRunner().invoke(app, words)
    assert told.exit_code == 0
    assert re.search(r"FC-1.*: emulated, as .* are needed; \d+ new runs with these distributions", told.stderr)
    answers = what_if(store, plan, ["J1.std=0.001"])
    assert all(answer.emulated and not answer.refusal for answer in answers.values())
    rows = store.table(plan.campaign_id).to_pandas()
    slopes = np.linalg.lstsq(np.column_stack([rows.J1, rows.preload, np.ones(400)]), rows["FC-1"], rcond=None)[0]
    sigma = np.hypot(slopes[0] * 0.001, slopes[1] * 0.1 / np.sqrt(12))
    low, high = answers["FC-1"].std.interval
    assert low < sigma < high
    previewed = what_if_from(plan, independent_samples(store, plan), ["J1.std=0.001"], emulates=False)
    assert all(answer.refusal for answer in previewed.values())


@pytest.mark.slow
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
    """Without a reject the command prints what a normal distribution expects, what the samples prove, and no 0."""
    store, plan = filled
    answer = what_if(store, plan, ["J1.std=0.017"])["FC-1"]
    assert answer.ppm.value * answer.effective < 1e6
    shown = CliRunner().invoke(app, ["whatif", plan.campaign_id, "--set", "J1.std=0.017", "--store", store.url]).stdout
    words = share_in_words(what_if_document(plan, store.url, [], {"FC-1": answer})["responses"]["FC-1"])
    assert words[1] == f"if normal; counted: at most {ppm(answer.ppm.interval[1])}"
    assert " ".join(words) in shown


@pytest.mark.parametrize(
    ("share", "expected", "words"),
    [
        (Estimate(1999.0, (0.0, 9e3), 500.0), 25.0, ("25.0", "if normal; counted: at most 9\u202f000")),
        (Estimate(0.0, (0.0, 9e3), 500.0), 1e-9, ("< 2.0", "if normal; counted: at most 9\u202f000")),
        (Estimate(0.0, (0.0, 9e3), 500.0), None, ("at most 9\u202f000", "")),
        (Estimate(2000.0, (900.0, 9e3), 500.0), 25.0, ("2\u202f000", "(900 to 9\u202f000)")),
        (Estimate(1e6, (1e6, 1e6), 500.0), 1e6, ("1\u202f000\u202f000", "")),
        (None, None, ("", "")),
    ],
)
def test_a_share_is_counted_from_one_effective_sample_on(share, expected, words):
    """Below, the share of a normal distribution leads, not below what 500 values can show."""
    answer = WhatIf(500, 0, 500.0, 0.002, 0.1, 0.6, 0.0, 1, ppm=share, ppm_expected=expected)
    assert share_in_words(asdict(answer)) == words


def test_a_variable_that_no_row_varies_is_not_emulated(campaign_file, tmp_path):
    """Rows in which a rare count is always 0 say nothing of a higher rate."""
    text, drawn = campaign_file.read_text(), 'distribution = "uniform"\nlower = 0.9\nupper = 1.0'
    assert drawn in text
    campaign_file.write_text(text.replace(drawn, 'distribution = "poisson"\nrate = 1e-4'))
    store, plan = computed(tmp_path / "s", load_campaign(str(campaign_file), samples=100), 100)
    assert not store.table()["preload"].to_numpy().any()
    answer = what_if(store, plan, ["preload.rate=2.0"])["FC-1"]
    assert answer.refusal
    assert "of preload lie beyond" in answer.notes[-1]


def fails_where_wide(mechanism, values, **settings):
    """Fail where J1 is wide."""
    return fake_engine.simulate(mechanism, values, status="ok" if values["J1"] < 0.1 else "not_converged")


def test_a_refusal_names_its_response_and_the_others_are_answered(campaign_file, tmp_path, monkeypatch):
    """Exit status 1 for a partial answer; the one without is named once; the share of failures is said."""
    store, plan = computed(tmp_path / "s", load_campaign(str(campaign_file), samples=400), 200, fails_where_wide)

    def partly(*question):
        answers = what_if(*question)
        return answers | {"FC-5": replace(answers["FC-5"], refusal="no sample with a value")}

    monkeypatch.setattr("clearcap.questions.whatif.what_if", partly)
    words = ["whatif", plan.campaign_id, "--set", "J1.std=0.016", "--store", store.url]
    asked = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    assert asked.exit_code == 1
    assert "no answer for FC-5: no sample with a value" in asked.stderr
    assert asked.stderr.count("no answer") == 1
    assert "% of the runs would have no value (now" in asked.stderr
    (row,) = (line for line in asked.stdout.splitlines() if "FC-2" in line)
    assert "to" in row
    monkeypatch.undo()
    nobody = CliRunner().invoke(app, ["whatif", plan.campaign_id, "--set", "J1.std=0.0001", "--store", store.url])
    assert "no answer for any response: " in nobody.stderr


def test_another_distribution_needs_no_further_key(filled):
    """J1.distribution=triangular keeps the bounds, and says so; in JSON too."""
    store, plan = filled
    words = ["whatif", plan.campaign_id, "--set", "J1.distribution=triangular", "--store", store.url]
    told = CliRunner().invoke(app, words)
    assert "J1 is now triangular, mode 0.07, between 0.01 and 0.13" in told.stderr
    assert "no longer used: mean, std" in told.stderr
    assert "its sigma was 0.01743 and is 0.02449" in told.stderr
    assert "unknown key" not in told.stderr
    assert json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)["assumed"][0].startswith(
        "J1 is now triangular"
    )


def test_the_ends_of_an_interval_differ_in_print():
    """As many digits as tell the ends of an interval from each other and from the value."""
    assert _cell(Estimate(10.793, (10.7921, 10.7939), 100.0)) == "10.793 (10.7921 to 10.7939)"
    assert _cell(Estimate(1e6 + 0.5, (1e6, 1e6 + 1), 100.0)) == "1000000.5 (1000000 to 1000001)"
    assert _cell(Estimate(0.0, (0.0, 0.0), 100.0)) == "0"
    assert _cell(Estimate(1.5, (1.0, 2.0), 100.0)) == "1.5 (1 to 2)"
    assert "no interval" in _cell(Estimate(1.5, (-np.inf, np.inf), 100.0))
