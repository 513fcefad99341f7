"""Measured lots against a campaign in a store: the distributions that they give, and the indices with them."""

import json
from statistics import NormalDist

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t
from typer.testing import CliRunner

import clearcap
from campaign.errors import SpecError
from campaign.spec.load import load_campaign_text
from campaign.store.monitored_library import read_monitored
from clearcap.cli import app
from clearcap.questions.whatif import what_if
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed

MANY = SPEC.replace("samples = 25", "samples = 2000")
# FC-1 by `fake_engine` is 10 + J1 + 2 preload, here 11.9 + J1: an index of 1.08
LIMITED = MANY.replace("lower = 0.9\nupper = 1.0", "lower = 0.949\nupper = 0.951").replace(
    "lsl = 9.0\nusl = 16.0", "lsl = 11.0\nusl = 12.03\nindex = 'cpk'\nrequirement = 1.05"
)


def quantiles(mean, std, n=200):
    """Return values whose shape is normal without chance, in no order."""
    x = np.array([NormalDist(mean, std).inv_cdf((i + 0.5) / n) for i in range(n)])
    return np.random.default_rng(3).permutation(mean + (x - mean) * std / x.std(ddof=1))


@pytest.fixture(scope="module")
def monitored_store(tmp_path_factory):
    """Return a store with a campaign of 2,000 samples, and its plan."""
    return computed(tmp_path_factory.mktemp("monitored") / "runs", load_campaign_text(LIMITED), 1000)


@pytest.fixture
def store(monitored_store):
    """Return the store; nothing was measured yet."""
    opened, plan = monitored_store
    opened.files.remove_tree(f"{plan.campaign_id}/monitored")
    return opened


@pytest.fixture
def plan(monitored_store):
    return monitored_store[1]


def test_the_parts_become_the_distribution_and_the_rows_are_weighted(store, plan):
    """The answer is that of what-if with the parts' own mean and sigma, and with the error that 200 parts leave."""
    found = clearcap.monitor_campaign(pd.DataFrame({"J1": quantiles(0.075, 0.014)}), plan.campaign_id, store.url)
    (variable,), (index,) = found.variables, found.responses
    assert (variable.variable, variable.parts, variable.family) == ("J1", 200, "normal")
    expected = what_if(store, plan, ["J1.mean=0.075", "J1.std=0.014"])["FC-1"].cpk
    assert (index.response, index.by) == ("FC-1", "cpk")
    assert index.index == pytest.approx(expected.value, rel=1e-6)
    of_parts = t.ppf(0.975, 199) * np.sqrt((1 / 9 + expected.value**2 / 2) / 200)
    ends = [
        expected.value + sign * np.hypot(expected.value - end, of_parts)
        for sign, end in zip((-1, 1), expected.interval, strict=True)
    ]
    assert index.interval == pytest.approx(ends, rel=0.02)
    assert read_monitored(store, plan.campaign_id) == found
    assert found.settings[0] == 'J1.distribution="truncated_normal"'


def test_a_fall_is_said_once_until_it_rises(store, plan):
    """And again after the index was above; earlier ones stay known."""

    def send(mean, std):
        parts = pd.DataFrame({"J1": quantiles(mean, std, 5000)})
        found = clearcap.monitor_campaign(parts, plan.campaign_id, store.url)
        return found.responses[0].below, [fall.number for fall in found.falls]

    usual, shifted = (0.07, 0.0175), (0.088, 0.0145)
    sent = [send(*each) for each in (usual, shifted, shifted, usual, shifted)]
    assert sent == [(False, []), (True, [2]), (True, [2]), (False, [2]), (True, [2, 5])]
    (_, last) = read_monitored(store, plan.campaign_id).falls
    assert (last.response, last.requirement) == ("FC-1", 1.05)
    assert last.interval[0] < last.index < last.interval[1] < 1.05


def test_few_parts_make_no_index_low_for_certain(store, plan):
    """The same mean and sigma, of 40 parts: the index is as low, but not for certain."""
    found = clearcap.monitor_campaign(pd.DataFrame({"J1": quantiles(0.088, 0.0145, 40)}), plan.campaign_id, store.url)
    (index,) = found.responses
    assert (index.index < 1.05 < index.interval[1], index.below) == (True, False)


def test_lots_become_the_lots_of_the_campaign(tmp_path):
    """Their scatter is that of the analysis of variance; values within them give the rest."""
    text = MANY.replace("upper = 0.13\n", "upper = 0.13\nbatch = { size = 20, std = 0.004 }\n")
    store, plan = computed(tmp_path / "runs", load_campaign_text(text), 1000)
    rng = np.random.default_rng(8)
    lots = np.repeat(np.arange(40), 10)
    x = 0.07 + rng.normal(0, 0.005, 40)[lots] + rng.normal(0, 0.016, 400)
    frame = pd.DataFrame({"J1": x, "charge": lots})
    limits = {"lot": "charge", "characteristics": {"J1": {}}}
    found = clearcap.monitor_campaign(frame, plan.campaign_id, store.url, limits=limits)
    means = frame.groupby("charge")["J1"].mean()
    within = frame.groupby("charge")["J1"].var().mean()
    between = means.var() - within / 10
    settings = dict(each.split("=") for each in found.settings)
    assert float(settings["J1.batch.std"]) == pytest.approx(np.sqrt(between), rel=1e-9)
    assert float(settings["J1.std"]) == pytest.approx(np.sqrt(within), rel=1e-2)
    assert found.variables[0].lots == 40
    alone = clearcap.monitor_campaign(frame, plan.campaign_id, store.url)
    assert alone.variables[0].lots is None
    assert float(dict(each.split("=") for each in alone.settings)["J1.std"]) == pytest.approx(x.std(ddof=1))


def test_a_skew_variable_gets_a_skew_family(store, plan):
    x = 0.02 + np.random.default_rng(5).gamma(2.0, 0.01, 400)
    found = clearcap.monitor_campaign(pd.DataFrame({"J1": x[x < 0.12]}), plan.campaign_id, store.url)
    assert found.variables[0].family not in ("", "normal")
    assert found.variables[0].p > 0.01


def test_where_the_rows_give_no_answer_a_campaign_is_asked_for(store, plan):
    """Parts beyond what was simulated: refused, and with rerun queued with their distribution."""
    parts = pd.DataFrame({"J1": quantiles(0.12, 0.0175)})
    refused = clearcap.monitor_campaign(parts, plan.campaign_id, store.url)
    assert "no samples" in refused.responses[0].refusal
    assert refused.campaign is None
    assert "upper bound 0.13 does not hold" in refused.variables[0].note
    asked = clearcap.monitor_campaign(parts, plan.campaign_id, store.url, rerun=True)
    new = store.plan(asked.campaign).spec
    assert new.variables["J1"].moments() == pytest.approx((0.12, 0.0175), rel=1e-3)
    assert new.variables["preload"] == plan.spec.variables["preload"]
    assert (new.samples, new.seed) == (2000, 7)
    assert store.read_json(asked.campaign, "state.json")["state"] == "queued"


def test_what_is_emulated_is_labelled(store, plan):
    """Parts that scatter far less than the samples: the weights carry nothing, an emulator of the rows does."""
    found = clearcap.monitor_campaign(pd.DataFrame({"J1": quantiles(0.07, 0.0002)}), plan.campaign_id, store.url)
    (index,) = found.responses
    assert index.refusal == ""
    assert index.emulated == what_if(store, plan, found.settings)["FC-1"].emulated != ""
    assert read_monitored(store, plan.campaign_id) == found


def test_what_does_not_fit_is_said(store, plan):
    """Too few values, values of few kinds, no column, a characteristic that is no variable, another unit."""
    few = pd.DataFrame({"J1": quantiles(0.07, 0.01)[:10], "preload": np.tile([0.9, 1.0], 5)})
    with pytest.raises(SpecError, match="10 values are too few"):
        clearcap.monitor_campaign(few, plan.campaign_id, store.url)
    both = pd.DataFrame({"J1": quantiles(0.07, 0.0175), "preload": np.tile([0.92, 0.97], 100)})
    found = clearcap.monitor_campaign(both, plan.campaign_id, store.url)
    assert [bool(each.family) for each in found.variables] == [True, False]
    assert "it stays" in found.variables[1].note
    assert not any(each.startswith("preload") for each in found.settings)
    with pytest.raises(SpecError, match="no column has the name of a variable"):
        clearcap.monitor_campaign(pd.DataFrame({"x": [1.0]}), plan.campaign_id, store.url)
    for limits in ({"FC-1": {"column": "J1"}}, {"J1": {"unit": "m"}}):
        with pytest.raises(SpecError, match="characteristics"):
            clearcap.monitor_campaign(both, plan.campaign_id, store.url, limits={"characteristics": limits})


def test_the_command(store, plan, tmp_path):
    """Exit status 1 where an index is below or has no answer; the document is what is kept."""
    pd.DataFrame({"J1": quantiles(0.07, 0.0175)}).to_csv(tmp_path / "night.csv", index=False)
    words = ["monitor", plan.campaign_id, str(tmp_path / "night.csv"), "--store", store.url]
    shown = CliRunner().invoke(app, words)
    kept = read_monitored(store, plan.campaign_id)
    assert shown.exit_code == int(any(each.below for each in kept.responses)), shown.output
    assert "FC-1" in shown.stdout
    assert kept.table == "night.csv"
    document = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert document["number"] == 1  # the same lots, sent twice
    assert document["responses"] == [each.model_dump(mode="json") for each in kept.responses]
    pd.DataFrame({"J1": quantiles(0.07, 0.0002)}).to_csv(tmp_path / "night.csv", index=False)
    assert "FC-1: emulated, as " in CliRunner().invoke(app, words).stderr
