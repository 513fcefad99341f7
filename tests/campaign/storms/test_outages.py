"""A store that fails for a while costs that while: the campaign goes on, and its rows are those of a quiet day."""

import logging
import subprocess
import threading
import time
from concurrent.futures import Future
from functools import partial

import pytest

from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import Coordinator, coordinate
from campaign.coordinator.dispatch import Window
from campaign.coordinator.lease import LeaseLost, lease_holder
from campaign.coordinator.submit import submit
from campaign.errors import StoreError
from campaign.spec.load import load_campaign
from campaign.store import Store, open_store
from campaign.store.files.retry_policy import RetryPolicy
from campaign.store.layout import HEARTBEAT, LEASE
from tests.campaign import fake_engine
from tests.campaign.driving import computed, rows
from tests.campaign.storms.disk import remount, tmpfs
from tests.until import until

QUICK = 20  # runs; the others are held until the store fails


@pytest.fixture
def asked(campaign_file):
    """Return a campaign of which most is left when the store fails."""
    return load_campaign(str(campaign_file), samples=150)


@pytest.fixture
def runs(tmp_path):
    """Return the file that counts runs; another one lets those that are held go on."""
    return tmp_path / "runs"


def go_on(runs):
    """Let the runs that are held go on."""
    runs.with_suffix(".end").touch()


def hurt(folder, store, plan, begin, end, seconds, struck, runs, is_noticed):
    """Wait until some parts are there, and have the store fail for a while, until the coordinator has noticed it."""
    until(lambda: len(store.files.hasty.names(f"{plan.campaign_id}/parts")) >= 5, "no parts")
    begin(folder)
    struck.append(store.survey(plan).rows)
    go_on(runs)
    time.sleep(seconds)
    until(is_noticed, "nobody notices that the store fails")
    end(folder)


def read_only(folder):
    assert remount(folder, "ro")


def writable(folder):
    assert remount(folder, "rw")


def take_all_inodes(folder):
    """Fill the file system with empty files."""
    try:
        for number in range(10_000):
            (folder / f"empty-{number}").touch()
    except OSError:
        return


def give_inodes_back(folder):
    for file in folder.glob("empty-*"):
        file.unlink()


def take_all_room(folder):
    subprocess.run(["dd", "if=/dev/zero", f"of={folder / 'filler'}", "bs=4k"], capture_output=True)


def give_room_back(folder):
    (folder / "filler").unlink()


OUTAGES = {
    "read-only for 3 s": (read_only, writable, 3.0),
    "read-only for 20 s": (read_only, writable, 20.0),
    "no inodes for 3 s": (take_all_inodes, give_inodes_back, 3.0),
    "no room for 3 s": (take_all_room, give_room_back, 3.0),
}


@pytest.mark.processes
@pytest.mark.slow
@pytest.mark.parametrize("outage", OUTAGES)
def test_outage_of_the_store(tmp_path, asked, workers, caplog, outage, runs):
    """Whatever part, heartbeat, lease or manifest comes to be written meanwhile, it is written after it."""
    caplog.set_level(logging.INFO)
    begin, end, seconds = OUTAGES[outage]
    reference = rows(*computed(tmp_path / "quiet", asked, 150))
    with tmpfs(tmp_path / "store", "4m,nr_inodes=600") as folder:
        store = open_store(str(folder / "s"))
        plan = submit(store, asked, 1)
        struck = []
        noticed = (runs, lambda: "trying again" in caplog.text)
        thread = threading.Thread(target=hurt, args=(folder, store, plan, begin, end, seconds, struck, *noticed))
        thread.start()
        held = partial(fake_engine.lasts, QUICK, str(runs))
        outcome = coordinate(store, plan, Cluster(workers=2), simulate=held)
        thread.join()
        assert 0 < struck[0] < 150
        assert outcome.survey.missing == []
        assert rows(store, outcome).equals(reference)
        assert lease_holder(store, plan.campaign_id) is None
        assert [name for name in store.files.names(f"{plan.campaign_id}/parts") if name.endswith(".tmp")] == []
    said = caplog.text
    assert (said.count("trying again"), said.count("answers again")) == (1, 1)


class Away:
    """A store of which one process sees nothing while it is away."""

    def __init__(self, store):
        self._backend, self.away, self.missed = store.files._backend, threading.Event(), []
        self.faults, self.is_final, self.reopen = OSError, self._backend.is_final, self._backend.reopen
        self.path, self.shared, self.root = self._backend.path, True, self._backend.root
        store.files._backend = self

    def within(self, answer_s):
        """Return itself: it fails at once."""
        return self

    def __getattr__(self, name):
        def operation(*arguments):
            if self.away.is_set():
                self.missed.append(name)
                raise OSError(5, "Input/output error")
            return getattr(self._backend, name)(*arguments)

        return operation


@pytest.fixture
def split(tmp_path, campaign):
    """Return a store, the view of it that its coordinator has, and the plan."""
    store, seen = (open_store(str(tmp_path / "s"), RetryPolicy(600.0, 0.05, 0.2)) for _ in range(2))
    return store, seen, submit(store, campaign, 1)


def during_outage(store, view, plan, action, runs):
    """Wait until rows come, take the store away from the coordinator until it notices, act, and give it back."""
    until(lambda: store.survey(plan).rows >= 3, "no rows")
    view.away.set()
    until(lambda: view.missed, "nobody notices that the store is away")
    action()
    view.away.clear()
    go_on(runs)


@pytest.mark.processes
@pytest.mark.parametrize("taken_over", [False, True])
def test_lease_after_an_outage(split, workers, taken_over, runs):
    """Who still holds the lease goes on; who lost it meanwhile ends, so that never both compute."""
    store, seen, plan = split
    view = Away(seen)

    def act():
        if taken_over:
            store.write_json(plan.campaign_id, LEASE, {"token": "theirs"})

    thread = threading.Thread(target=during_outage, args=(store, view, plan, act, runs))
    thread.start()
    slow = partial(fake_engine.lasts, 3, str(runs))
    if taken_over:
        with pytest.raises(LeaseLost, match="was taken over by another process"):
            coordinate(seen, plan, Cluster(workers=2), simulate=slow)
        assert lease_holder(store, plan.campaign_id) == "theirs"
    else:
        assert coordinate(seen, plan, Cluster(workers=2), simulate=slow).survey.missing == []
        assert lease_holder(store, plan.campaign_id) is None
    thread.join()


@pytest.mark.processes
def test_heartbeat_that_cannot_be_written(tmp_path, campaign, workers, monkeypatch):
    """Batches go on all the same: here the heartbeat is refused until ten of them are in the store."""
    store = open_store(str(tmp_path / "s"), RetryPolicy(600.0, 0.05, 0.2))
    plan = submit(store, campaign, 1)
    write_json, refused = Store.write_json, []

    def refuse_heartbeats(self, campaign_id, name, content):
        if name == HEARTBEAT and store.survey(plan).rows < 10:
            refused.append(name)
            raise StoreError("store s: heartbeat.json cannot be written")
        write_json(self, campaign_id, name, content)

    monkeypatch.setattr(Store, "write_json", refuse_heartbeats)
    assert coordinate(store, plan, Cluster(workers=2), simulate=fake_engine.simulate).survey.missing == []
    assert refused


def test_store_that_fails_a_worker_is_tried_by_others(store, plan, caplog):
    """A worker that lost its mount costs its batch; a third one in a row ends the campaign with the store's words."""
    coordinator = Coordinator(store, plan, "token", lambda _: None)
    request, failed, done = coordinator.queue.next(), Future(), Future()
    failed.set_exception(StoreError("store s: part cannot be written"))
    done.set_result([])
    for future in (failed, failed, done, failed, failed):
        coordinator._handle_result(Window(FakeWorkers(), coordinator.address), [request], future)
    assert coordinator.queue.next() == request
    assert "is computed again, because its worker gave up: store s: part cannot be written" in caplog.text
    with pytest.raises(StoreError, match="part cannot be written"):
        coordinator._handle_result(Window(FakeWorkers(), coordinator.address), [request], failed)


class FakeWorkers:
    """Workers of whom only the number is asked."""

    def count(self):
        """Return one."""
        return 1
