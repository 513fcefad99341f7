"""How long a run takes, tried before batches are cut: measured where it matters, and never at the price of a fault."""

from dataclasses import replace
from functools import partial

import pytest

from campaign.coordinator.submit import ENOUGH, RUNS, known_seconds_per_run, seconds_per_run, submit
from campaign.plan import UNTRIED_BATCH, batch_size_is_fixed, make_plan
from campaign.store import open_store, part_name
from campaign.worker.row import rows_in_process
from tests.campaign import fake_engine
from tests.campaign.driving import computed


@pytest.fixture
def clock():
    """Return a clock that the test turns."""

    class Clock:
        now = 1000.0

        def __call__(self):
            return self.now

    return Clock()


def child(clock, starts, takes, monkeypatch):
    """Put in the place of a child one whose start and whose runs take so long by a clock; return its runs so far."""
    runs = []

    def rows(address, samples, attempt):
        clock.now += starts
        for row in rows_in_process(address, samples, attempt):
            clock.now += takes
            runs.append(row["sample"])
            yield row | {"wall_s": takes}

    monkeypatch.setattr("campaign.coordinator.submit.rows_in_subprocess", rows)
    return runs


def test_time_of_a_run_is_measured(plan, clock, monkeypatch):
    """A run that takes 0.25 s counts as that, without the start of the process."""
    runs = child(clock, 30.0, 0.25, monkeypatch)
    assert seconds_per_run(plan, fake_engine.simulate, clock) == 0.25
    assert len(runs) == RUNS


@pytest.mark.processes
def test_time_in_a_process_of_its_own(plan, tmp_path):
    """By the machine's clock, of runs elsewhere."""
    assert seconds_per_run(plan, partial(fake_engine.counts, str(tmp_path / "runs"))) > 0.0
    assert (tmp_path / "runs").stat().st_size == RUNS


@pytest.mark.processes
def test_run_that_kills_its_process_is_no_measure(plan):
    """Nothing is known then, and the campaign can be planned all the same."""
    assert seconds_per_run(plan, partial(fake_engine.goes_wrong, {"segfault": (0.0, 1.0)})) is None


def test_a_long_run_is_tried_once(plan, clock, monkeypatch):
    """After a run of more than ENOUGH seconds no other is tried: who submits waits for one."""
    runs = child(clock, 30.0, ENOUGH + 1.0, monkeypatch)
    assert seconds_per_run(plan, fake_engine.simulate, clock) == ENOUGH + 1.0
    assert len(runs) == 1


def test_the_only_run_is_the_measure(campaign, clock, monkeypatch):
    """Of a campaign of one sample, although that run includes the start of the engine."""
    runs = child(clock, 30.0, 0.25, monkeypatch)
    assert seconds_per_run(make_plan(of_a_size(campaign, 1)), fake_engine.simulate, clock) == 0.25
    assert runs == [0]


def long(mechanism, values, **settings):
    """Say that the run took half a second."""
    run = fake_engine.simulate(mechanism, values)
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
    store, other = computed(tmp_path / "s", of_a_size(campaign, 2, seed=3), 1, long)
    new = make_plan(of_a_size(campaign, 4000), None)
    assert known_seconds_per_run(store, new) == store.read_part(other, 0)["wall_s"][0].as_py() == 0.5
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
