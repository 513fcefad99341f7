"""How long a run takes, tried before batches are cut: measured where it matters, and never at the price of a fault."""

from dataclasses import replace
from functools import partial

import pytest

from campaign.coordinator.run_time import RUNS, seconds_per_run
from campaign.coordinator.submit import submit
from campaign.plan import batch_size_is_fixed, make_plan
from campaign.store import open_store
from tests.campaign import fake_engine


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
