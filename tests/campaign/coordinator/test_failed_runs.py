"""Campaigns whose runs fail: they stop before their end, lose nothing, and say how many failed and what to do."""

from dataclasses import replace
from functools import partial

import pytest

from campaign.coordinator.failed_runs import TooManyFailed, check_failures, lack_of_ok, what_to_do
from campaign.coordinator.heartbeat import Progress
from campaign.coordinator.rerun import failed_samples
from campaign.coordinator.state import state_of
from campaign.plan import Plan, make_plan
from campaign.samples import independent_samples
from campaign.spec.campaign_file import FIRST_RUNS, Failures
from campaign.spec.load import load_campaign
from campaign.store import open_store
from clearcap.questions.report import report_spec
from reporting import ReportSpec
from tests.campaign import fake_engine
from tests.campaign.driving import computed, start

SLIDES = partial(fake_engine.simulate, status="not_converged", message="not at rest at the horizon")


def stored(folder) -> tuple[Plan, dict[str, int]]:
    """Return the plan of the only campaign of a store, and its rows by status."""
    store = open_store(str(folder))
    plan = store.plan(store.find(None))
    return plan, store.survey(plan).statuses


@pytest.mark.processes
def test_a_campaign_stops_when_its_first_runs_all_fail(tmp_path, campaign_file, workers):
    """It keeps their rows and quotes one of them; resumed, it computes as many again, or all if one is ok."""
    loaded = load_campaign(str(campaign_file), samples=1500)
    with pytest.raises(TooManyFailed, match=r"\d+ not_converged") as stopped:
        start(tmp_path / "s", loaded, batch_size=20, simulate=SLIDES)
    plan, first = stored(tmp_path / "s")
    assert FIRST_RUNS <= first["not_converged"] < 700
    assert "sample 0, not_converged: not at rest at the horizon" in str(stopped.value)
    assert f"clearcap resume {plan.campaign_id} --workers 2 --store {tmp_path / 's'}" in str(stopped.value)
    assert state_of(open_store(str(tmp_path / "s")), plan.campaign_id)["state"] == "failed"
    with pytest.raises(TooManyFailed):
        start(tmp_path / "s", loaded, batch_size=20, simulate=SLIDES)
    again = stored(tmp_path / "s")[1]["not_converged"]
    assert first["not_converged"] + FIRST_RUNS <= again < 1300
    _, outcome = start(tmp_path / "s", loaded, batch_size=20)
    assert outcome.survey.statuses == {"not_converged": again, "ok": 1500 - again}


@pytest.mark.processes
def test_a_stated_number_of_failures_has_all_samples_computed(tmp_path, campaign_file, workers):
    campaign_file.write_text(campaign_file.read_text() + "\n[failures]\nmax_failed = 150\n")
    _, outcome = start(tmp_path / "s", load_campaign(str(campaign_file), samples=150), batch_size=30, simulate=SLIDES)
    assert outcome.survey.statuses == {"not_converged": 150}


@pytest.mark.parametrize(
    ("ok", "done", "most", "hopeless"),
    [(0, FIRST_RUNS, None, True), (0, FIRST_RUNS - 1, None, False), (1, 5000, None, False), (0, 5000, 0.9, False)],
)
def test_first_runs_that_all_fail_are_hopeless(ok, done, most, hopeless):
    assert Failures(max_failed=most).is_hopeless(ok, done) is hopeless


@pytest.mark.processes
def test_a_completed_campaign_says_that_too_few_runs_are_ok(tmp_path, campaign, workers):
    """Its state has the message, which status and watch print."""
    store, outcome = start(tmp_path / "s", campaign, simulate=partial(fake_engine.raises_above, 0.07))
    failed = outcome.survey.statuses["crashed"]
    assert 0 < failed < 25
    message = f"{failed} of 25 runs failed ({failed} crashed); failures.min_ok requires 99 % ok runs"
    state = state_of(store, outcome.plan.campaign_id)
    assert state["state"] == "completed"
    assert state["message"].startswith(message)
    assert lack_of_ok(outcome.plan, {"ok": 99, "crashed": 1}) == ""
    assert lack_of_ok(outcome.plan, {}) == ""


def test_what_to_do_quotes_the_most_frequent_status(tmp_path, campaign):
    store, plan = computed(tmp_path / "s", campaign, 25, fake_engine.needs_a_short_step)
    said = what_to_do(store, plan)
    assert said.startswith("sample 0, not_converged: residual 1e-3\n")
    assert f"clearcap replay {plan.campaign_id} 0 --store {store.url}" in said


def test_samples_that_cannot_be_assembled_are_failures_only_without_a_limit(tmp_path, campaign):
    """With one they neither stop a campaign, nor are computed again, counted as failed, or in what is advised on."""
    unfit = partial(fake_engine.unfit_above, 0.07)
    store, plan = computed(tmp_path / "s", campaign, 25, unfit)
    stored = store.survey(plan).statuses
    lost = stored["not_assemblable"]
    assert 0 < lost < 25
    assert plan.failed(stored) == lost == len(failed_samples(store, plan))
    assert "failures.max_not_assemblable" in what_to_do(store, plan)
    assert independent_samples(store, plan).number.size == 25
    spec = campaign.spec.model_copy(update={"failures": Failures(max_failed=0, max_not_assemblable=0.9)})
    store, plan = computed(tmp_path / "t", replace(campaign, spec=spec), 25, unfit)
    assert store.survey(plan).statuses == stored
    assert plan.failed(stored) == 0
    assert store.plan_header(plan.campaign_id).failed({**stored, "jammed": 2}) == 2
    assert failed_samples(store, plan) == []
    assert len(failed_samples(store, plan, ["not_assemblable"])) == lost
    assert independent_samples(store, plan).number.size == 25 - lost
    progress = Progress(store, plan, store.survey(plan))
    assert (progress.failed, progress.done) == (0, 25)
    check_failures(store, plan, progress)  # raises where a failed run is one too many


def test_the_least_share_of_ok_runs_is_that_of_a_report():
    assert Failures().min_ok == ReportSpec.min_ok == 0.99


def test_a_report_goes_by_the_stated_share_of_ok_runs(campaign_file):
    campaign_file.write_text(campaign_file.read_text() + "\n[failures]\nmin_ok = 0.5\n")
    assert report_spec(make_plan(load_campaign(str(campaign_file)))).min_ok == 0.5
