"""A sample becomes a row: whatever happens in its run, the answer is a row; and what makes two rows the same."""

from functools import partial

import numpy as np
import pytest

from campaign.coordinator.rerun import failed_samples
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.spec.result_columns import LATER_COLUMNS
from campaign.store import open_store
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from campaign.worker.row import _same, compute_row, rows_in_process, sample_values
from engine import simulate
from engine.loop import Cancel
from tests.campaign import fake_engine
from tests.campaign.driving import computed

POLICY = """
[failures]
retry = [{ step = 0.002, tolerance = 1e-7 }, { step = 0.001 }]
"""

ROW = {
    "status": "ok",
    "message": "",
    "steps": 79,
    "max_residual": 1e-9,
    "max_penetration": 4e-9,
    "max_created_energy": 2e-9,
    "created_energy": 3e-9,
    "max_lost_energy": 4e-9,
    "lost_energy": 5e-9,
    "max_kinetic_energy": 6e-6,
    "max_turn": 7e-3,
    "start_travel": 0.0,
    "settled": True,
    "at_impact": "",
    "ambiguous": False,
    "wall_s": 0.01,
    "FC-1": 12.6,
}


def run_rows(store, plan, simulate):
    """Return the rows of all samples, computed one by one."""
    return list(rows_in_process(CampaignAddress.of(store, plan, simulate), range(plan.spec.samples)))


def test_settings_reach_the_engine(campaign_file, tmp_path):
    """Step and horizon of the campaign are the run's."""
    text = campaign_file.read_text()
    campaign_file.write_text(text.replace("[variables.J1]", "[simulation]\nstep = 0.004\n\n[variables.J1]"))
    plan = make_plan(load_campaign(str(campaign_file)), 5)
    store = open_store(str(tmp_path / "runs"))
    store.create_plan(plan)
    seen = []

    def listens(mechanism, values, *, step=None, horizon=None, cancel=None):
        seen.append((step, horizon))
        return fake_engine.simulate(mechanism, values)

    run_batch(CampaignAddress.of(store, plan, listens), BatchRequest(0))
    assert seen == [(0.004, None)] * 5


def test_a_run_that_raises_is_a_row(store, plan):
    """An exception becomes a ``crashed`` row with its message and inputs; neighbours are untouched."""
    whole = run_rows(store, plan, fake_engine.simulate)
    limit = sorted(row["J1"] for row in whole)[-3]
    rows = run_rows(store, plan, partial(fake_engine.raises_above, limit))
    failed = [row for row in rows if row["status"] != "ok"]
    assert len(failed) == 2
    for row, before in zip(rows, whole, strict=True):
        if row["J1"] > limit:
            assert (row["status"], row["message"]) == ("crashed", "ArithmeticError: no solution")
            assert (row["FC-1"], row["max_residual"], row["settled"]) == (None, None, False)
            assert (row["J1"], row["preload"]) == (before["J1"], before["preload"])
        else:
            assert row == before


def test_ok_without_a_number_is_not_ok(store, plan):
    """A response that is not finite never enters a table as a result."""
    row = run_rows(store, plan, fake_engine.not_finite)[0]
    assert (row["status"], row["message"], row["FC-2"]) == ("invalid", "no finite value of FC-1", None)


def test_failed_runs_are_tried_with_other_settings(campaign_file, tmp_path):
    """In turn, until one succeeds; the row says what came before, and is the last attempt's."""
    campaign_file.write_text(campaign_file.read_text() + POLICY)
    store, _ = computed(tmp_path, load_campaign(str(campaign_file)), 100, fake_engine.needs_a_short_step)
    rows = store.table().to_pylist()
    assert {row["attempts"] for row in rows} == {3}
    before = (
        "settings of the mechanism: not_converged (residual 1e-3); "
        "step 0.002, tolerance 1e-07: not_converged (residual 1e-3)"
    )
    assert {row["earlier_attempts"] for row in rows} == {before}
    for row in rows:
        status = "diverged" if row["J1"] > 0.09 else "ok"
        assert (row["status"], row["FC-1"] is None) == (status, status != "ok")
    assert {row["status"] for row in rows} == {"ok", "diverged"}


def test_a_cancelled_run_is_not_tried_again(campaign_file):
    """Its attempt ends because it was cancelled, which no retry would fix."""
    campaign_file.write_text(campaign_file.read_text() + POLICY)
    plan = make_plan(load_campaign(str(campaign_file)), 10)
    cancel, tried = Cancel(), []

    def cancelled(mechanism, values, **settings):
        tried.append(settings)
        settings["cancel"].set()
        return fake_engine.simulate(mechanism, values, status="not_converged")

    assert compute_row(plan, cancelled, 0, sample_values(plan, 0), 1, cancel)["status"] == "not_converged"
    assert len(tried) == 1


def test_a_good_run_is_tried_once(campaign_file, tmp_path):
    """Nor is one tried again that other settings cannot fix."""
    campaign_file.write_text(campaign_file.read_text() + POLICY)
    crashing = partial(fake_engine.raises_above, 0.07)
    store, _ = computed(tmp_path, load_campaign(str(campaign_file)), 100, crashing)
    table = store.table()
    assert set(table["status"].to_pylist()) == {"ok", "crashed"}
    assert set(table["attempts"].to_pylist()) == {1}
    assert set(table["earlier_attempts"].to_pylist()) == {""}


def test_limits_reach_the_engine(campaign_file, tmp_path):
    """The campaign's limit of real time is the run's, and its tolerance."""
    tables = "[repeats]\nshare = 0\n\n[simulation]\ntolerance = 1e-6\n\n[execution]\ntime_limit = 5.0\n\n[variables.J1]"
    campaign_file.write_text(campaign_file.read_text().replace("[variables.J1]", tables))
    seen = {}

    def listens(mechanism, values, **settings):
        seen.update(values)
        return fake_engine.simulate(mechanism, values)

    computed(tmp_path, load_campaign(str(campaign_file)), 100, listens)
    assert seen.keys() == {"J1", "springs.A3.preload", "simulation.wall_limit", "simulation.tolerance"}
    assert (seen["simulation.wall_limit"], seen["simulation.tolerance"]) == (5.0, 1e-6)


def test_a_mechanism_that_does_not_come_to_rest_is_a_row_of_its_own_status(tmp_path):
    """With the real engine: a status, a message that names body and motion, no response; another horizon is tried."""
    campaign = load_campaign(
        {
            "format": 1,
            "name": "swing",
            "mechanism": "clearance_pendulum",
            "samples": 3,
            "seed": 1,
            "simulation": {"horizon": 0.5},
            "failures": {"retry": [{"horizon": 0.6}]},
            "variables": {"J1": {"distribution": "uniform", "lower": 2e-4, "upper": 9e-4}},
        }
    )
    store, plan = computed(tmp_path, campaign, 3, simulate)
    for row in store.table().to_pylist():
        assert (row["status"], row["settled"], row["attempts"]) == ("not_at_rest", False, 2)
        assert row["message"].startswith("not at rest at the horizon of 0.6 s: link swings about z, the axis of J1 at ")
        assert row["earlier_attempts"].startswith(
            "horizon 0.5: not_at_rest (not at rest at the horizon of 0.5 s: link "
        )
        assert (row["drop"], row["tip"]) == (None, None)
    assert failed_samples(store, plan, ["not_at_rest"]) == [0, 1, 2]
    assert failed_samples(store, plan, ["not_converged"]) == []


def test_a_sample_that_cannot_be_assembled_is_a_row_of_its_own_status(tmp_path):
    """A block drawn into its slope, or a slope into its block, is moved out; both together are too far for that.

    The depth is that of the origins times cos 30 degrees; a block may be moved by 1 % of its extent, 2.9 mm.
    """
    depths = {"block": [-0.003, -0.003, 0.001], "slope": [0.0, 0.003, 0.0]}
    variables = {
        name: {"target": f"bodies.{name}.origin.z", "distribution": "uniform", "lower": min(at), "upper": max(at)}
        for name, at in depths.items()
    }
    campaign = {"format": 1, "name": "sunk", "mechanism": "incline", "samples": 3, "sampler": "list"}
    campaign |= {"variables": variables, "table": {"columns": depths}}
    store, plan = computed(tmp_path, load_campaign(campaign), 3, simulate)
    first, second, third = store.table().to_pylist()
    assert [row["status"] for row in (first, second, third)] == ["ok", "not_assemblable", "ok"]
    assert first["start_travel"] == pytest.approx(0.003 * np.cos(np.pi / 6), rel=1e-6)
    assert second["message"].startswith("the nearest pose without overlap moves block by 0.005196 m; allowed: ")
    assert (second["slide"], second["start_travel"], third["start_travel"]) == (None, None, 0.0)
    assert failed_samples(store, plan, ["not_assemblable"]) == [1]


def test_a_row_of_an_earlier_build_lacks_columns():
    """It is compared in what it has."""
    earlier = {name: value for name, value in ROW.items() if name not in LATER_COLUMNS}
    assert _same(ROW, earlier, ["FC-1"])


@pytest.mark.parametrize(("name", "same"), [("created_energy", False), ("FC-1", False), ("wall_s", True)])
def test_rows_differ_in_what_the_sample_determines(name, same):
    """One bit is enough; the time of the clock does not count."""
    assert _same(ROW | {name: ROW[name] * (1 + 1e-15)}, ROW, ["FC-1"]) == same
