"""The cheapest tolerances, judged and improved by fresh runs: against closed forms, and where the rows mislead."""

import json
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from typer.testing import CliRunner

import clearcap
from campaign.samples import independent_samples
from campaign.spec.load import load_campaign
from campaign.store.store import repeated_shares
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from clearcap.cli import app
from clearcap.questions.confirmation import confirm
from clearcap.questions.tolerances import costs_of
from tests.campaign import fake_engine
from tests.campaign.driving import computed

LEVER = """\
format = 1
name = "lever"
mechanism = "c60"
samples = 300
seed = 3

[variables.J1]
distribution = "normal"
mean = 0.07
std = 0.006

[variables.J2]
distribution = "normal"
mean = 0.07
std = 0.006

[responses.FC-1]
lsl = 9.845
usl = 10.155
"""
COSTS = {"variables": {"J1": {"cost": 0.05}, "J2": {"cost": 0.03}}}
SLOPES = np.array([3.0, 2.0])


def lever(gain, mechanism, values, **settings):
    """Return a run whose FC-1 is linear in J1 and J2."""
    run = fake_engine.simulate(mechanism, values)
    one, two = values["J1"] - 0.07, values["J2"] - 0.07
    return replace(run, responses=run.responses | {"FC-1": 10 + gain * (SLOPES[0] * one + SLOPES[1] * two)})


@pytest.fixture
def asked(tmp_path):
    """Return a store, a plan with rows, the costs, and what computes a further campaign of a lever."""

    def make(fresh_gain=1.0, text=LEVER, costs=COSTS):
        path = tmp_path / "lever.toml"
        path.write_text(text)
        store, plan = computed(tmp_path / "s", load_campaign(str(path)), 300, partial(lever, 1.0))

        def compute(fresh):
            address = CampaignAddress.of(store, fresh, partial(lever, fresh_gain), repeated_shares(store, fresh))
            for batch in range(len(fresh.batches)):
                run_batch(address, BatchRequest(batch))

        return store, plan, costs_of(costs, plan, "costs:"), compute

    return make


def test_tolerances_grow_beyond_the_first_rows_to_the_closed_form(asked):
    """Lagrange's optimum needs nearly twice the sigmas: fresh rows reach where the first ones do not."""
    store, plan, costs, compute = asked()
    found = confirm(store, plan, costs, compute)
    assert found.outcome == "confirmed"
    (judged,) = found.rounds[-1].responses
    for verdict, words in (("reached", "confirmed by "), ("within error", "not refuted by ")):
        last = replace(found.rounds[-1], responses=(replace(judged, verdict=verdict),))
        assert replace(found, rounds=(last,)).text.startswith(words)
    assert found.rounds[0].proposal.method == "emulation"
    assert found.rounds[0].proposal.covered == ("J1", "J2")
    assert len(found.rounds) > 1
    shape = np.cbrt(np.array([0.05, 0.03]) / SLOPES**2)
    best = shape * 0.155 / (3 * 1.33) / math.sqrt(np.sum((SLOPES * shape) ** 2))
    assert min(best) > 1.6 * 0.006
    assert list(found.proposal.tolerances.values()) == pytest.approx(best, rel=0.06)  # 865 runs know sigma to 2.4 %
    assert found.proposal.cost < found.proposal.cost_now
    assert found.proposal.factors["J1"] == pytest.approx(found.proposal.tolerances["J1"] / 0.006)
    (last,) = found.rounds[-1].responses
    assert last.cpk_interval[0] < 1.33 < last.cpk_interval[1] or last.verdict == "reached"
    fresh = independent_samples(store, store.plan(found.rounds[-1].campaign))
    assert np.std(fresh.values["J1"]) == pytest.approx(found.proposal.tolerances["J1"], rel=0.1)
    assert not np.intersect1d(fresh.values["J1"], independent_samples(store, plan).values["J1"]).size
    again = confirm(store, plan, costs, pytest.fail)
    assert again == found


def test_what_the_rows_do_not_show_is_found_by_the_fresh_ones(asked):
    """Where fresh runs are steeper than the rows say, the first proposal misses; the next does not."""
    store, plan, costs, compute = asked(1.25, LEVER.replace("9.845", "9.888").replace("10.155", "10.112"))
    found = confirm(store, plan, costs, compute)
    first, last = found.rounds[0], found.rounds[-1]
    assert first.missed
    assert first.responses[0].cpk < 1.33
    assert found.outcome == "confirmed", found.text
    assert last.responses[0].cpk > first.responses[0].cpk
    assert last.proposal.cost > first.proposal.cost


def test_without_runs_it_waits_and_without_a_set_it_refuses(asked):
    """Queued campaigns are named; what no tolerance reaches is refused with its reason."""
    store, plan, costs, _ = asked()
    found = confirm(store, plan, costs)
    assert (found.outcome, found.rounds[-1].state) == ("computing", "queued")
    assert found.rounds[-1].campaign in found.text
    narrow = {"variables": {name: {**cost, "lower": 0.005} for name, cost in COSTS["variables"].items()}}
    store, plan, costs, _ = asked(text=LEVER.replace("9.845", "9.98").replace("10.155", "10.02"), costs=narrow)
    found = confirm(store, plan, costs)
    assert (found.outcome, found.rounds) == ("refused", ())
    assert "FC-1: with every tolerance at its lower bound" in found.text


def test_runs_that_fail_confirm_nothing(asked):
    """If fewer than the campaign requires are ok, the proposal is not confirmed, and the text says so."""
    store, plan, costs, _ = asked()

    def breaks(fresh):
        def simulate(mechanism, values, **settings):
            run = lever(1.0, mechanism, values)
            if values["J1"] < 0.07:
                return replace(run, status="not_converged", message="J1 is small", responses={})
            return run

        for batch in range(len(fresh.batches)):
            run_batch(CampaignAddress.of(store, fresh, simulate, repeated_shares(store, fresh)), BatchRequest(batch))

    found = confirm(store, plan, costs, breaks)
    assert found.outcome == "missed"
    assert "runs failed" in found.text


@pytest.mark.processes
def test_the_command_confirms_and_continues(tmp_path):
    """Two variables of the C-60: rounds are computed, printed and, the second time, only read."""
    path, cost = tmp_path / "c.toml", tmp_path / "costs.toml"
    path.write_text(LEVER.replace("lsl = 9.845\nusl = 10.155", "lsl = 12.0\nusl = 13.2").replace("300", "100"))
    cost.write_text("".join(f"[variables.{name}]\ncost = 0.01\nupper = 0.0072\n" for name in ("J1", "J2")))
    where = ["--store", str(tmp_path / "s")]
    assert CliRunner().invoke(app, ["run", str(path), *where, "--no-report", "--workers", "1"]).exit_code == 0
    command = ["advise", *where, "--cost", str(cost), "--confirm", "--json"]
    told = CliRunner().invoke(app, [*command, "--workers", "1"])
    document = json.loads(told.stdout)["confirmation"]
    assert (told.exit_code == 0) == (document["outcome"] == "confirmed")
    assert document["rounds"][0]["responses"][0]["response"] == "FC-1"
    (first,) = {each["rows"] for each in document["rounds"][:1]}
    again = clearcap.open_campaign(first, tmp_path / "s").confirm(cost, progress=False)
    assert again.outcome == document["outcome"]
    assert again.rounds[-1].responses[0].cpk == document["rounds"][-1]["responses"][0]["cpk"]
