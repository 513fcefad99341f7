"""How long a run takes, tried before batches are cut: measured where it matters, and never at the price of a fault."""

from dataclasses import replace
from functools import partial

import pytest

from campaign.coordinator.run_time import RUNS, known_seconds_per_run, seconds_per_run
from campaign.coordinator.submit import submit
from campaign.plan import UNTRIED_BATCH, batch_size_is_fixed, make_plan
from campaign.store import open_store, part_name
from tests.campaign import fake_engine
from tests.campaign.driving import computed


def test_time_of_a_run_is_measured(plan):
    """A run that takes 0.2 s counts as that and what a row takes, without the start of the process."""
    assert 0.2 <= seconds_per_run(plan, partial(fake_engine.takes, 0.2)) < 0.6


def test_run_that_kills_its_process_is_no_measure(plan):
    """Nothing is known then, and the campaign can be planned all the same."""
    assert seconds_per_run(plan, partial(fake_engine.goes_wrong, {"segfault": (0.0, 1.0)})) is None


def test_a_long_run_is_tried_once(plan, tmp_path, monkeypatch):
    """After a run of ENOUGH seconds no other is tried: who submits waits for one."""
    monkeypatch.setattr("campaign.coordinator.run_time.ENOUGH", 0.2)
    counted = tmp_path / "runs"
    assert seconds_per_run(plan, partial(counting, str(counted))) >= 0.5
    assert counted.read_text().count("x") < RUNS


def counting(path, mechanism, values, **settings):
    """Take a while and leave a mark."""
    with open(path, "a", encoding="utf-8") as file:
        file.write("x")
    run = fake_engine.takes(0.5, mechanism, values, **settings)
    return replace(run, certificate=replace(run.certificate, wall_s=0.5))


@pytest.mark.parametrize("samples", [1, 40, 79, 80, 81, 4000])
def test_nothing_is_tried_where_it_decides_nothing(samples, tmp_path, campaign, monkeypatch):
    """Small campaigns have batches of one sample whatever a run takes; others depend on it."""
    spec = campaign.spec.model_copy(update={"samples": samples})
    sized = type(campaign)(spec, campaign.mechanism)
    sizes = {make_plan(sized, None, seconds).batches for seconds in (None, 1e-6, 0.1, 20.0)}
    assert (len(sizes) == 1) == batch_size_is_fixed(samples)
    tried = []
    monkeypatch.setattr("campaign.coordinator.submit.seconds_per_run", lambda *_: tried.append(1))
    submit(open_store(str(tmp_path / "s")), sized)
    assert len(tried) == (0 if batch_size_is_fixed(samples) else 1)


def of_a_size(campaign, samples, **changes):
    """Return the campaign with so many samples and other changes of its spec."""
    return type(campaign)(campaign.spec.model_copy(update={"samples": samples, **changes}), campaign.mechanism)


def test_time_of_a_run_is_known_from_other_campaigns(tmp_path, campaign):
    """The mean of a file of rows of the same mechanism and settings, whatever is drawn; a bad file is passed."""
    took = partial(counting, str(tmp_path / "runs"))
    store, other = computed(tmp_path / "s", of_a_size(campaign, 2, seed=3), 1, took)
    new = make_plan(of_a_size(campaign, 4000), None)
    assert known_seconds_per_run(store, new) == store.read_part(other, 0)["wall_s"][0].as_py() >= 0.5
    store.files.write(part_name(other, 0), b"damaged")
    assert known_seconds_per_run(store, new) == store.read_part(other, 1)["wall_s"][0].as_py()
    coarse = campaign.spec.simulation.model_copy(update={"step": 0.01})
    assert known_seconds_per_run(store, make_plan(of_a_size(campaign, 4000, simulation=coarse), None)) is None
    store.files.write("demo-0123456789/plan.json", b"{}")
    assert known_seconds_per_run(store, new) is not None
    assert known_seconds_per_run(open_store(str(tmp_path / "empty")), new) is None


def test_a_server_that_submits_simulates_nothing(tmp_path, campaign, monkeypatch):
    """Batches fit the time that is known, and are small where none is."""
    monkeypatch.setattr("campaign.coordinator.submit.seconds_per_run", lambda *_: pytest.fail("it simulates"))
    monkeypatch.setattr("subprocess.Popen", lambda *_, **__: pytest.fail("it starts a process"))
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, of_a_size(campaign, 40_000), tries_runs=False)
    assert plan.batches[0] == (0, UNTRIED_BATCH)
    monkeypatch.setattr("campaign.coordinator.submit.known_seconds_per_run", lambda *_: 0.1)
    assert submit(store, of_a_size(campaign, 50_000), tries_runs=False).batches[0] == (0, 100)
    monkeypatch.setattr("campaign.coordinator.submit.known_seconds_per_run", lambda *_: 1.0)
    assert submit(store, of_a_size(campaign, 60_000), tries_runs=False).batches[0] == (0, 10)
    assert submit(store, of_a_size(campaign, 40_000), tries_runs=False) == plan
