"""What breaks around a campaign while it runs: disk, clock, lease, parts, builds. Clear words, and nothing lost."""

import os
import signal
import subprocess
import sys
import uuid
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from random import Random

import psutil
import pytest

from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.dispatch import TRIES
from campaign.coordinator.state import state_of
from campaign.coordinator.submit import submit
from campaign.errors import StoreError
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.layout import CANCEL, LEASE
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from tests.campaign import fake_engine
from tests.campaign.cluster_processes import free_port, scheduler, worker
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.campaign.storms.checks import bits, check_whole
from tests.campaign.storms.cluster import DASK, drive, start_cluster, strike
from tests.campaign.storms.disk import remount, tmpfs
from tests.campaign.storms.supervisor import ROOT, Supervisor, processes, those_left, words
from tests.until import until

pytestmark = [pytest.mark.slow, pytest.mark.processes]


@pytest.fixture
def asked(campaign_file):
    """Return a campaign of 300 samples."""
    return load_campaign(str(campaign_file), samples=300)


@pytest.fixture
def reference(tmp_path, asked):
    """Return the table of a quiet day."""
    return bits(*computed(tmp_path / "quiet", asked, 100))


@pytest.fixture
def supervisor(tmp_path):
    """Return a supervisor whose processes are all gone at the end."""
    with Supervisor(tmp_path, str(uuid.uuid4()), **DASK) as started:
        yield started
    assert those_left(started.mark) == []


def driven(folder, asked, supervisor, batch_size, seconds, *options):
    """Have a campaign driven on a cluster; return its store, its plan, and the scheduler's address."""
    store = open_store(str(folder / "s"))
    plan = submit(store, asked, batch_size)
    address = start_cluster(supervisor, supervisor.folder)
    drive(supervisor, store, plan, address, seconds, *options)
    return store, plan, address


def finish(supervisor):
    """Wait for the coordinator's end."""
    until(lambda: supervisor.finished("coordinator"), lambda: supervisor.said("coordinator"))


def parts(store, plan):
    return [n for n in store.files.names(f"{plan.campaign_id}/parts") if n.endswith(".parquet")]


@contextmanager
def workers_paused(supervisor):
    """Stop the workers while the block runs."""
    workers = [process for process in processes(supervisor.mark) if "spawn_main" in " ".join(words(process))]
    assert workers
    for worker_process in workers:
        worker_process.suspend()
    try:
        yield
    finally:
        for worker_process in workers:
            with suppress(psutil.Error):
                worker_process.resume()


def test_disk_full(tmp_path, asked, reference, supervisor):
    """The coordinator says so and pauses, open for the next one; with room again the campaign ends as always."""
    with tmpfs(tmp_path / "full", "400k") as folder:
        store, plan, _ = driven(folder, asked, supervisor, 3, 0.01, "--patience", 3)
        until(lambda: supervisor.codes.get("coordinator"), lambda: supervisor.said("coordinator"))
        assert supervisor.codes["coordinator"][0] == StoreError.exit_code
        assert "No space left on device" in supervisor.said("coordinator")
        before = set(parts(store, plan))
        assert 0 < len(before) < 100
        assert remount(folder, "size=20m")
        finish(supervisor)
        assert before <= set(parts(store, plan))
        check_whole(store, plan, reference)


def test_store_becomes_read_only(tmp_path, asked, reference, supervisor):
    """A store that takes nothing for a while costs time; the coordinator that gave up is followed by one that ends."""
    with tmpfs(tmp_path / "ro", "20m") as folder:
        store, plan, _ = driven(folder, asked, supervisor, 3, 0.02, "--patience", 3)
        until(lambda: len(parts(store, plan)) > 5, lambda: supervisor.said("coordinator"))
        assert remount(folder, "ro")
        until(lambda: supervisor.codes.get("coordinator"), lambda: supervisor.said("coordinator"))
        assert "Read-only file system" in supervisor.said("coordinator")
        assert remount(folder, "rw")
        finish(supervisor)
        store.files.sweep(f"{plan.campaign_id}/parts")
        check_whole(store, plan, reference)


@pytest.mark.parametrize("jump", ["+40d", "-40d"])
def test_clock_jumps(tmp_path, asked, reference, supervisor, jump):
    """A coordinator whose clock is 40 days off does its work, and the next one with the right clock goes on."""
    library = "/usr/lib/x86_64-linux-gnu/faketime/libfaketime.so.1"
    if not os.path.exists(library):
        pytest.skip("needs libfaketime (Debian: faketime)")
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, asked, 3)
    address = start_cluster(supervisor, tmp_path)
    words = [sys.executable, "-m", "tests.campaign.storms.driver", store.url, plan.campaign_id]
    environment = {
        **supervisor.environment,
        "LD_PRELOAD": library,
        "FAKETIME": jump,
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }
    with subprocess.Popen([*words, "--scheduler", address, "--seconds", "0.01"], env=environment) as wrong:
        until(lambda: len(parts(store, plan)) > 20 or wrong.poll() is not None, "nothing comes")
        assert wrong.poll() is None
        wrong.kill()
    drive(supervisor, store, plan, address, 0.01)
    finish(supervisor)
    store.files.sweep(f"{plan.campaign_id}/parts")
    store.files.sweep(plan.campaign_id)
    check_whole(store, plan, reference)


def test_two_coordinators_with_the_lease_forced_open(tmp_path, asked, reference, supervisor):
    """Somebody removes the lease while one drives: both compute, the same table comes of it."""
    store, plan, address = driven(tmp_path, asked, supervisor, 3, 0.02)
    until(lambda: len(parts(store, plan)) > 5, lambda: supervisor.said("coordinator"))
    store.remove(plan.campaign_id, LEASE)
    drive(supervisor, store, plan, address, 0.02, name="second")
    both = ("coordinator", "second")
    until(lambda: all(map(supervisor.finished, both)), lambda: "\n".join(map(supervisor.said, both)))
    check_whole(store, plan, reference)


def test_part_damaged_while_it_runs(tmp_path, asked, reference, supervisor):
    """A part that was sound and is not any more at the end is named, quarantined, and computed again."""
    store, plan, _ = driven(tmp_path, asked, supervisor, 3, 0.02)
    until(lambda: len(parts(store, plan)) > 5, lambda: supervisor.said("coordinator"))
    names = [f"{plan.campaign_id}/parts/{name}" for name in parts(store, plan)[:2]]
    whole = store.files.read(names[0])
    store.files.write(names[0], whole[:200] + b"x" + whole[201:])  # as long as before
    store.files.write(names[1], store.files.read(names[1])[:-10])
    finish(supervisor)
    said = supervisor.said("coordinator")
    for name in names:
        quarantined = name.rsplit("/", 1)[-1] + ".bad"
        assert f"quarantined as {quarantined}" in said
        store.files.remove(f"{plan.campaign_id}/parts/{quarantined}")
    check_whole(store, plan, reference)


def test_damage_without_end_is_said(tmp_path, asked, monkeypatch, workers):
    """A disk that never reads back what was written ends the campaign with these words, not in a loop."""
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, asked, 150)
    surveys = []

    def damaged(files, *_, **how):
        surveys.append(how)
        return replace(sound(files, *_, **how), parts={}, missing=[0, 1])

    sound = type(store).survey
    monkeypatch.setattr(type(store), "survey", damaged)
    with pytest.raises(StoreError, match=f"{TRIES} times in a row; check the disk"):
        coordinate(store, plan, Cluster(workers=1), simulate=fake_engine.simulate)


def test_a_sound_worker_is_waited_for(tmp_path, asked, reference):
    """One worker of another build, and the sound one killed: its successor under another address gets the batches."""
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, asked, 3)
    address = f"tcp://127.0.0.1:{(port := free_port())}"
    other = tmp_path / "other" / "sitecustomize.py"
    other.parent.mkdir()
    other.write_text("from campaign import row_build\nrow_build.row_build = lambda: 'engine ffffffffffffffff'\n")
    root = str(ROOT)
    wrong = {"PYTHONPATH": f"{other.parent}:{root}"}
    right = {"PYTHONPATH": root}
    marker = tmp_path / "killed"
    with (
        scheduler(port, environment=DASK | right),
        worker(address, tmp_path / "w", environment=wrong),
        worker(address, tmp_path / "r", environment=right),
    ):
        slow_then_killed = partial(fake_engine.kills_once, str(marker))
        outcome = coordinate(store, plan, Cluster(scheduler=address), simulate=slow_then_killed)
    assert marker.exists()
    assert outcome.survey.missing == []
    check_whole(store, plan, reference)


def test_cancel_then_resume(tmp_path, asked, reference, supervisor):
    """``cancel`` ends the coordinator; when the marker is removed, another one completes the campaign."""
    store, plan, _ = driven(tmp_path, asked, supervisor, 3, 0.02)
    until(lambda: len(parts(store, plan)) > 5, lambda: supervisor.said("coordinator"))
    command = [sys.executable, "-m", "clearcap", "cancel", plan.campaign_id, "--store", store.url]
    with workers_paused(supervisor):  # however long the command takes to start
        subprocess.run(command, check=True, env=supervisor.environment, capture_output=True)
        until(lambda: 3 in supervisor.codes.get("coordinator", []), lambda: supervisor.said("coordinator"))
    before = parts(store, plan)
    assert 0 < len(before) < 100
    store.remove(plan.campaign_id, CANCEL)
    finish(supervisor)
    check_whole(store, plan, reference)


def test_terminated_coordinator_leaves_it_open(tmp_path, asked, reference, supervisor):
    """SIGTERM, as of a supervisor that restarts it: the campaign is open, without a lease, and the next one ends it."""
    store, plan, _ = driven(tmp_path, asked, supervisor, 3, 0.05)
    until(lambda: len(parts(store, plan)) > 5, lambda: supervisor.said("coordinator"))
    seen = []
    with supervisor.held():
        os.kill(supervisor.pid("coordinator"), signal.SIGTERM)
        until(lambda: 143 in supervisor.codes.get("coordinator", []), lambda: supervisor.said("coordinator"))
        seen.append(state_of(store, plan.campaign_id))
        assert store.read_json(plan.campaign_id, LEASE) is None
    assert (seen[0]["state"], seen[0]["open"]) == ("interrupted", True)
    finish(supervisor)
    check_whole(store, plan, reference)


def test_coordinator_is_killed_while_it_repeats(tmp_path, campaign_file, supervisor):
    """Kill -9 with all rows there and some repeats: the next one computes the missing ones, and no file again."""
    campaign_file.write_text(SPEC.replace("[variables.J1]", "[repeats]\nshare = 0.5\n[variables.J1]", 1))
    asked = load_campaign(str(campaign_file), samples=120)
    quiet = bits(*computed(tmp_path / "quiet", asked, 100))
    store = open_store(str(tmp_path / "s"))
    plan = submit(store, asked, 3)
    for batch in range(len(plan.batches)):
        run_batch(CampaignAddress.of(store, plan, fake_engine.simulate), BatchRequest(batch))
    folder = tmp_path / "s" / plan.campaign_id
    drive(supervisor, store, plan, start_cluster(supervisor, supervisor.folder), 0.05)
    repeats = folder / "repeats-1"
    until(lambda: len(list(repeats.glob("*.parquet"))) > 5, lambda: supervisor.said("coordinator"))
    assert strike(supervisor, "coordinator", Random(1))
    before = {path: path.stat().st_mtime_ns for path in folder.glob("*/*.parquet")}
    assert len(before) < 40 + 40
    finish(supervisor)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    check_whole(store, plan, quiet)


def test_isolated_subprocesses_are_killed(tmp_path, asked, reference, supervisor):
    """Kill -9 of an isolated subprocess: its run is repeated, and no row blames it (three kills in a row would)."""
    store, plan, _ = driven(tmp_path, asked, supervisor, 30, 0.05)
    chance, struck = Random(1), 0
    until(lambda: len(parts(store, plan)) > 1, lambda: supervisor.said("coordinator"))
    while struck < 2 and not supervisor.finished("coordinator"):
        before = len(parts(store, plan))
        strike(supervisor, "worker", chance)
        until(lambda: strike(supervisor, "child", chance) or supervisor.finished("coordinator"), "no child")
        struck += 1
        until(lambda before=before: len(parts(store, plan)) > before + 1, lambda: supervisor.said("coordinator"))
    assert struck
    finish(supervisor)
    check_whole(store, plan, reference)
