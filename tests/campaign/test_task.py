"""A batch: whatever happens in a run, the answer is a row."""

import pickle
from functools import partial

import pytest

from campaign.errors import CampaignError
from campaign.sampling import draw
from campaign.task import Task, run_batch, run_sample
from tests.campaign import fake_engine


def address(store, plan, simulate):
    return Task(store.url, plan.campaign_id, plan.engine_build, simulate)


def test_rows_hold_inputs_responses_and_certificate(store, plan):
    """A row is the sample's inputs, the responses of a run with them, and the run's certificate."""
    done = run_batch(address(store, plan, fake_engine.simulate), 2)
    assert done == {"batch": 2, "statuses": {"ok": 5}}
    row = store.read_part(plan, 2).to_pylist()[3]
    drawn = {name: x[0] for name, x in draw(plan.spec.variables, 7, 23, 1).items()}
    run = fake_engine.simulate(plan.mechanism, {"J1": drawn["J1"], "springs.A3.preload": drawn["preload"]})
    certificate = {
        "steps": 1000,
        "wall_s": 0.0,
        "max_residual": 1e-9,
        "max_penetration": 1e-9,
        "settled": True,
    }
    ending = {"status": "ok", "message": "", "attempts": 1}
    assert row == {"sample": 23, **drawn, **run.responses, **certificate, **ending}


def test_settings_reach_the_engine(campaign_file, tmp_path):
    """Step and horizon of the campaign are the run's."""
    from campaign.load import load_campaign
    from campaign.plan import make_plan
    from campaign.store import open_store

    text = campaign_file.read_text()
    campaign_file.write_text(text.replace("[variables.J1]", "[simulation]\nstep = 0.004\n\n[variables.J1]"))
    plan = make_plan(load_campaign(str(campaign_file)), 5)
    store = open_store(str(tmp_path / "runs"))
    store.create_plan(plan)
    seen = []

    def listens(mechanism, values, *, step=None, horizon=None):
        seen.append((step, horizon))
        return fake_engine.simulate(mechanism, values)

    run_batch(address(store, plan, listens), 0)
    assert seen == [(0.004, None)] * 5


def test_a_run_that_raises_is_a_row(store, plan):
    """An exception becomes a ``crashed`` row with its message and inputs; neighbours are untouched."""
    whole = run_rows(store, plan, fake_engine.simulate, "a")
    limit = sorted(row["J1"] for row in whole)[-3]
    rows = run_rows(store, plan, partial(fake_engine.raises_above, limit), "b")
    failed = [row for row in rows if row["status"] != "ok"]
    assert len(failed) == 2
    for row, before in zip(rows, whole, strict=True):
        if row["J1"] > limit:
            assert (row["status"], row["message"]) == ("crashed", "ArithmeticError: no solution")
            assert (row["FC-1"], row["max_residual"], row["settled"]) == (None, None, False)
            assert (row["J1"], row["preload"]) == (before["J1"], before["preload"])
        else:
            assert row == before


def run_rows(store, plan, simulate, name):
    """Return the rows of all samples, computed one by one."""
    return [run_sample(address(store, plan, simulate), sample, 1) for sample in range(plan.spec.samples)]


def test_ok_without_a_number_is_not_ok(store, plan):
    """A response that is not finite never enters a table as a result."""
    row = run_rows(store, plan, fake_engine.not_finite, "c")[0]
    assert (row["status"], row["message"], row["FC-2"]) == ("invalid", "no finite value of FC-1", None)


def test_part_that_is_there_is_not_computed(store, plan):
    """A batch that arrives twice is computed once."""
    run_batch(address(store, plan, fake_engine.simulate), 0)
    done = run_batch(address(store, plan, partial(fake_engine.raises_above, -1.0)), 0)
    assert done["statuses"] == {"ok": 10}


def test_other_engine_build_is_refused(store, plan):
    """A worker with another engine refuses the campaign, naming both builds."""
    task = Task(store.url, plan.campaign_id, "0123456789abcdef", fake_engine.simulate)
    with pytest.raises(CampaignError, match=f"build 0123456789abcdef, this process runs {plan.engine_build}"):
        run_batch(task, 0)


def test_task_is_small(store, plan):
    """What travels to a worker stays under a kilobyte."""
    assert len(pickle.dumps(Task(store.url, plan.campaign_id, plan.engine_build))) < 1000
