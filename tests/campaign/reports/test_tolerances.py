"""How far tolerances may grow, and which set is cheapest."""

from dataclasses import replace

import pytest
from typer.testing import CliRunner

from campaign.cli import app
from campaign.plan import make_plan
from campaign.reports.cost_file import read_costs
from campaign.reports.tolerances import cheapest_tolerances, tolerance_advice
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from reporting import capability
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


def test_every_cost_law_gets_a_proposal_from_the_command(campaign_file, tmp_path):
    """Power, exponential and processes in one file; the chosen process is named, with its standard deviation."""
    store, plan = computed(tmp_path / "s", load_campaign(str(campaign_file), samples=400), 200)
    path = tmp_path / "costs.toml"
    path.write_text(
        "[variables.J1]\n"
        "processes = [{std = 0.03, cost = 1, name = 'drilled'}, {std = 0.001, cost = 9, name = 'honed'}]\n"
        "[variables.preload]\ncost = 2.0\nscale = 0.1\n"
    )
    told = CliRunner().invoke(app, ["advise", plan.campaign_id, "--store", store.url, "--cost", str(path)])
    assert told.exit_code == 0, told.output
    assert "drilled" in told.stdout or "honed" in told.stdout
    assert "process" in told.stdout


def test_a_response_that_is_below_does_not_hide_the_others(campaign_file, tmp_path):
    """What may grow is asked of the capable responses; what must shrink, of each that is not, to lift it to 1.33."""
    path = campaign_file.parent / "narrow.toml"
    path.write_text(campaign_file.read_text() + "\n[responses.FC-2]\nlsl = 16.99\nusl = 18.79\n")
    store, plan = computed(tmp_path / "s", load_campaign(str(path), samples=400), 200)
    table = store.table(plan.campaign_id)
    cpk = capability(table["FC-2"].to_numpy(), lsl=16.99, usl=18.79).cpk
    assert 1.0 < cpk < 1.33
    grow, below = tolerance_advice(store, plan)
    (j1, preload) = grow
    assert 1.0 < j1.interval[0] == j1.factor
    assert (preload.factor, preload.ended_by) == (1.0, "samples")  # a uniform variable has no sample beyond its ends
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
