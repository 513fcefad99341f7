"""A batch: its rows in one part, computed once, by the engine the plan is for."""

import pickle
import re
from functools import partial
from importlib.metadata import version

import pytest

from campaign.inputs.sampling import draw
from campaign.worker import batch as computing
from campaign.worker.batch import rows_in_subprocess, run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress, WrongBuild
from tests.campaign import fake_engine


def test_rows_hold_inputs_responses_and_certificate(store, plan):
    """A row is the sample's inputs, the responses of a run with them, and the run's certificate."""
    done = run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(2))
    assert (done.part.batch, done.part.rows, done.part.statuses, done.computed) == (2, 5, {"ok": 5}, True)
    row = store.read_part(plan, 2).to_pylist()[3]
    drawn = {name: x[0] for name, x in draw(plan.spec, 23, 1).items()}
    run = fake_engine.simulate(plan.mechanism, {"J1": drawn["J1"], "springs.A3.preload": drawn["preload"]})
    certificate = {
        "steps": 1000,
        "wall_s": 0.0,
        "max_residual": 1e-9,
        "max_penetration": 1e-9,
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
    }
    ending = {"status": "ok", "message": "", "attempts": 1, "earlier_attempts": ""}
    assert row == {"sample": 23, **drawn, **run.responses, **certificate, **ending}


def test_part_that_is_there_is_not_computed(store, plan, monkeypatch):
    """A batch that arrives twice is computed once, and its part is read, not written again."""
    first = run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(0))
    monkeypatch.setattr("campaign.store.store.encode", None)
    again = run_batch(CampaignAddress.of(store, plan, partial(fake_engine.raises_above, -1.0)), BatchRequest(0))
    assert again.part.statuses == {"ok": 10}
    assert again.part.sha256 == first.part.sha256
    assert (first.computed, again.computed) == (True, False)
    assert again.part == first.part


@pytest.mark.parametrize("error", [OSError(24, "Too many open files"), ImportError("gone"), MemoryError()], ids=repr)
def test_error_of_the_machine_is_no_row(store, plan, tmp_path, error):
    """A run that raises an error that may be the machine's is repeated in a process of its own."""
    unlucky = partial(fake_engine.raises_at_first, error, str(tmp_path / "raised"))
    done = run_batch(CampaignAddress.of(store, plan, unlucky), BatchRequest(2))
    assert (tmp_path / "raised").stat().st_size == 1 + 5
    assert done.part.statuses == {"ok": 5}


@pytest.mark.processes
def test_error_of_the_machine_that_stays_is_a_row(store, plan, monkeypatch):
    """If process after process meets it, it is the run's."""
    monkeypatch.setattr(computing, "TRIES", 2)
    address = CampaignAddress.of(store, plan, partial(fake_engine.raises, OSError(5, "Input/output error")))
    (row,) = rows_in_subprocess(address, [3], 1)
    assert (row["status"], row["message"], row["attempts"]) == ("crashed", "OSError: [Errno 5] Input/output error", 2)


def test_another_build_is_refused(store, plan):
    """A worker of another build refuses the campaign, naming what differs."""
    other = plan.row_build.replace(f"scipy {version('scipy')}", "scipy 1.2.3")
    address = CampaignAddress(store.url, plan.campaign_id, other, fake_engine.simulate)
    with pytest.raises(WrongBuild, match=re.escape(f"(scipy {version('scipy')} here, 1.2.3 in the plan)")):
        run_batch(address, BatchRequest(0))


def test_address_is_small(store, plan):
    """What travels to a worker stays under a kilobyte."""
    assert len(pickle.dumps(CampaignAddress(store.url, plan.campaign_id, plan.row_build))) < 1000
