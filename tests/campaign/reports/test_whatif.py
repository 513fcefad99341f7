"""Questions to samples without new runs: ratios of densities, settings, cost files, and the verbs."""

import json
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

from campaign.cli import app
from campaign.errors import CampaignError, SpecError
from campaign.inputs.sampling import draw
from campaign.plan import make_plan
from campaign.reports.changed_distributions import change_distributions, changed_variables, scale_spread
from campaign.reports.cost_file import read_costs
from campaign.reports.tolerances import cheapest_tolerances, tolerance_advice
from campaign.reports.whatif import what_if
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from reporting import capability
from tests.campaign import fake_engine
from tests.campaign.driving import computed


def cut(mean: float, std: float) -> stats.rv_continuous:
    """Return the truncated normal distribution of J1."""
    return stats.truncnorm((0.01 - mean) / std, (0.13 - mean) / std, mean, std)


@pytest.fixture
def filled(campaign, tmp_path):
    """Return a store and a plan of 400 samples with rows of the fake engine."""
    plan = make_plan(replace(campaign, spec=campaign.spec.model_copy(update={"samples": 400})), 200)
    store = open_store(str(tmp_path / "runs"))
    store.create_plan(plan)
    for batch in range(len(plan.batches)):
        run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(batch))
    return store, plan


def test_the_ratio_is_that_of_the_densities(campaign):
    """Against scipy's truncated normal, and a uniform variable cut to half its width."""
    spec, columns = campaign.spec, draw(campaign.spec, 0, 25)
    new = changed_variables(spec, ["J1.std=0.01", "J1.mean=0.072", "preload.upper=0.95"])
    found = change_distributions(spec, new, columns)
    of_j1 = cut(0.072, 0.01).logpdf(columns["J1"]) - cut(0.07, 0.0175).logpdf(columns["J1"])
    of_preload = np.where(columns["preload"] <= 0.95, np.log(2.0), -inf)
    np.testing.assert_allclose(found.log_ratio, of_j1 + of_preload, rtol=1e-9)
    assert found.outside == 0.0
    assert change_distributions(spec, changed_variables(spec, ["preload.lower=0.8"]), columns).outside == pytest.approx(
        0.5
    )


def test_widening_follows_the_law_and_says_how_far_it_came(campaign):
    """A truncated normal keeps its bounds, so twice its std is less than twice its spread; a uniform one stretches."""
    columns = draw(campaign.spec, 0, 25)
    found = scale_spread(campaign.spec, {"J1": 2.0}, columns)
    assert found.spread == pytest.approx(cut(0.07, 0.035).std() / cut(0.07, 0.0175).std(), rel=1e-6)
    stretched = scale_spread(campaign.spec, {"preload": 1.25}, columns)
    np.testing.assert_allclose(stretched.log_ratio, np.log(0.8), rtol=1e-9)
    assert stretched.outside == pytest.approx(0.2)
    both = scale_spread(campaign.spec, {"J1": 2.0, "preload": 0.5}, columns)
    inside = np.abs(columns["preload"] - 0.95) <= 0.025
    np.testing.assert_allclose(both.log_ratio[inside], found.log_ratio[inside] + np.log(2), rtol=1e-9)
    assert np.all(both.log_ratio[~inside] == -inf)


def test_correlated_variables_keep_their_copula(campaign):
    """Weighted samples have the moments of samples drawn anew, products too, within 5 standard errors."""
    variables = {**campaign.spec.variables, "J2": campaign.spec.variables["J1"]}
    asked = {"variables": variables, "correlations": (("J1", "J2", 0.7),), "samples": 40_000}
    spec = campaign.spec.model_copy(update=asked)
    new = changed_variables(spec, ["J1.std=0.013", "J2.mean=0.073"])
    old, fresh = draw(spec, 0, 40_000), draw(spec.model_copy(update={"variables": {**variables, **new}}), 0, 40_000)
    weight = np.exp(change_distributions(spec, new, old).log_ratio)
    for of in (lambda x: x["J1"], lambda x: x["J2"], lambda x: (x["J1"] - 0.07) * (x["J2"] - 0.07)):
        a, b = of(old), of(fresh)
        mean = np.sum(weight * a) / weight.sum()
        error = np.hypot(np.sqrt(np.sum((weight * (a - mean)) ** 2)) / weight.sum(), b.std() / 200)
        assert abs(mean - b.mean()) < 5 * error


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("J9.std=0.01", "VARIABLE one of J1, preload"),
        ("J1=0.01", "allowed is VARIABLE.KEY=VALUE"),
        ("J1.sigma=0.01", "unknown key"),
        ("J1.std=-1", "variables.J1.std = -1"),
        ("J1.std=wide", "must be a number"),
        ("preload.lower=2.0", "not below upper"),
        ("J1.distribution=gauss", "unknown distribution"),
    ],
)
def test_a_setting_that_cannot_be_is_one_message(campaign, setting, said):
    """It names the key, and what is allowed."""
    with pytest.raises(SpecError, match="--set") as error:
        changed_variables(campaign.spec, [setting])
    assert said in str(error.value)


def test_samples_of_no_distribution_are_not_weighted(filled):
    """Corners, grids and lists are refused before a row is read."""
    store, plan = filled
    corners = replace(plan, spec=plan.spec.model_copy(update={"sampler": "worst_case"}))
    with pytest.raises(SpecError, match="drawn from no distribution"):
        what_if(store, corners, ["J1.std=0.01"])
    with pytest.raises(SpecError, match="drawn from no distribution"):
        tolerance_advice(store, corners)


def test_a_campaign_without_rows_is_one_message(store, plan):
    """Nothing done, nothing to ask."""
    with pytest.raises(CampaignError, match="no sample is done yet"):
        what_if(store, plan, ["J1.std=0.01"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "variables"),
        ("[variables.J1]\ncost = -1", "variables.J1.cost"),
        ("[variables.J9]\ncost = 1", "variables.J9: no variable"),
        ("target = [", "no TOML"),
    ],
)
def test_a_cost_file_with_a_fault_is_one_message(plan, tmp_path, text, said):
    """It names file and key."""
    path = tmp_path / "costs.toml"
    path.write_text(text)
    with pytest.raises(SpecError, match=r"costs\.toml") as error:
        read_costs(path, plan)
    assert said in str(error.value)
    with pytest.raises(SpecError, match="No such file"):
        read_costs(tmp_path / "none.toml", plan)


def test_the_cheapest_set_keeps_what_is_locked(filled, tmp_path):
    """A free variable moves, a locked one does not; the runs that confirm it are told."""
    store, plan = filled
    path = tmp_path / "costs.toml"
    path.write_text("[variables.J1]\ncost = 0.05\n[variables.preload]\ncost = 1.0\nlocked = true\n")
    found = cheapest_tolerances(store, plan, read_costs(path, plan))
    assert found.runs > 500
    if not found.refusal:
        assert found.factors["preload"] == pytest.approx(1.0)
        assert found.cost <= found.cost_now


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
    """Samples that share a shift are no independent ones, and who asks is told."""
    path = campaign_file.parent / "batches.toml"
    path.write_text(campaign_file.read_text().replace("std = 0.0175", "std = 0.0175\nbatch = {size = 20, std = 0.002}"))
    store, plan = computed(tmp_path / "s", load_campaign(str(path), samples=400), 200)
    asked = ["whatif", plan.campaign_id, "--set", "J1.std=0.016", "--store", store.url]
    assert "intervals take them for independent" in CliRunner().invoke(app, asked).stderr


def test_a_response_that_is_below_does_not_hide_the_others(campaign_file, tmp_path):
    """What may grow is asked of the capable responses; what must shrink, of each that is not, to lift it to 1.33."""
    path = campaign_file.parent / "narrow.toml"
    path.write_text(campaign_file.read_text() + "\n[responses.FC-2]\nlsl = 16.99\nusl = 18.79\n")
    store, plan = computed(tmp_path / "s", load_campaign(str(path), samples=400), 200)
    table = store.table(plan.campaign_id)
    cpk = capability(table["FC-2"].to_numpy(), lsl=16.99, usl=18.79).cpk
    assert 1.0 < cpk < 1.33
    grow, below = tolerance_advice(store, plan)
    assert all(each.factor > 1.0 for each in grow)
    assert list(below) == ["FC-2"]
    helping = [each for each in below["FC-2"] if each.factor is not None]
    assert helping
    assert all(each.factor < 1.0 and each.cpk == pytest.approx(1.33, abs=0.01) for each in helping)
    told = CliRunner().invoke(app, ["advise", plan.campaign_id, "--store", store.url]).stdout
    assert "FC-2 is below Cpk 1.33" in told


def test_a_constant_has_no_tolerance(campaign_file, tmp_path):
    """Nothing is advised of a variable that does not vary."""
    path = campaign_file.parent / "constant.toml"
    path.write_text(campaign_file.read_text() + '\n[variables.J2]\ndistribution = "constant"\nvalue = 0.05\n')
    store, plan = computed(tmp_path / "s", load_campaign(str(path), samples=400), 200)
    assert "J2" in plan.spec.variables
    assert [each.variable for each in tolerance_advice(store, plan)[0]] == ["J1", "preload"]


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
