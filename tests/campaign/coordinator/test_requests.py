"""Deleting a campaign: whatever interrupts it, there is the whole campaign or none, and what is left is removed."""

import os
import signal
import subprocess
import sys
import threading

import pytest

import campaign.coordinator.lease as leases
import campaign.coordinator.requests as deleting
from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.lease import LeaseHeld, LeaseLost, hold_lease, take_lease
from campaign.coordinator.requests import delete_campaign, finish_deletion, is_half_deleted, unfinished_deletions
from campaign.coordinator.service import serve
from campaign.coordinator.state import state_of, write_state
from campaign.coordinator.submit import submit
from campaign.errors import StoreError
from campaign.store import open_store
from campaign.store.files.files import Files
from campaign.store.files.retry_policy import HASTY
from campaign.store.labels import LabelChange, change_labels, read_labels
from campaign.store.layout import DELETED, LEASE, PLAN
from tests.campaign.commands import clearcap_here
from tests.campaign.store.test_store import fill


class Killed(BaseException):
    """The process is no more."""


@pytest.fixture
def whole(either_store, plan):
    """Return a store with a campaign that has rows, a report, labels and a state."""
    fill(either_store, plan)
    either_store.record(plan, either_store.survey(plan).parts.values())
    either_store.files.write(f"{plan.campaign_id}/report/report.html", b"x")
    either_store.files.write(f"{plan.campaign_id}/comparisons/other-1/report.html", b"x")
    change_labels(either_store, plan.campaign_id, LabelChange("alice"))
    write_state(either_store, plan.campaign_id, "completed")
    return either_store


def test_nothing_is_left(whole, plan):
    """Neither a file nor a folder, and nothing that another deletion would finish."""
    delete_campaign(whole, plan.campaign_id)
    assert (whole.campaigns(), whole.files.names(""), unfinished_deletions(whole)) == ([], [], [])


def killed_after(monkeypatch, operations):
    """Have the main thread end before an operation on files, and do none after it, as after a kill."""
    do, done = Files._do, []

    def counted(self, *words, **options):
        if threading.current_thread() is threading.main_thread():
            done.append(1)
            if len(done) > operations:
                raise Killed
        return do(self, *words, **options)

    monkeypatch.setattr(Files, "_do", counted)


@pytest.mark.slow
def test_interrupted_anywhere(whole, plan, monkeypatch):
    """After any number of operations: all rows, or no campaign; then it is deleted to its end."""
    monkeypatch.setattr(leases, "RACE_WAIT", 0.0)
    name, operations, is_over, halves = plan.campaign_id, 0, False, 0
    while not is_over:
        with monkeypatch.context() as patch:
            killed_after(patch, operations)
            try:
                delete_campaign(whole, name)
                is_over = True
            except Killed:
                pass
        if whole.files.exists(f"{name}/{LEASE}"):  # as one of a process that is no more
            whole.write_json(name, LEASE, {**whole.read_json(name, LEASE), "started": "1"})
        if whole.campaigns():
            assert (whole.survey(whole.plan(name)).rows, state_of(whole, name)["state"]) == (25, "completed")
        else:
            assert state_of(whole, name)["open"] is False
            halves += is_half_deleted(whole, name)
        operations += 1
    assert halves > 3
    assert operations > 10
    assert whole.files.names("") == []


def half_deleted(store, plan):
    """Leave a campaign as a kill does that comes when its plan is renamed."""
    store.files.move(f"{plan.campaign_id}/{PLAN}", f"{plan.campaign_id}/{DELETED}")


@pytest.mark.processes
def test_a_half_deleted_campaign_is_none(whole, plan, capsys, monkeypatch):
    """No verb finds it but delete, which finishes it without asking; list says so, and a service passes it over."""
    half_deleted(whole, plan)
    assert unfinished_deletions(whole) == [plan.campaign_id]
    assert serve(whole, Cluster(workers=1), report=None, once=True) == []
    place = ("--store", whole.url)
    code, printed, said = clearcap_here(capsys, monkeypatch, "list", *place)
    assert (code, printed) == (0, "")
    assert f"its deletion was interrupted; finish it with: clearcap delete {plan.campaign_id} --store" in said
    assert clearcap_here(capsys, monkeypatch, "status", plan.campaign_id, *place)[0] == 2
    assert clearcap_here(capsys, monkeypatch, "delete", plan.campaign_id[:-2], *place)[0] == 0
    assert (unfinished_deletions(whole), whole.files.names(plan.campaign_id)) == ([], [])


def test_submitted_again_it_is_new(whole, plan, campaign):
    """Nothing of the one that was half deleted is in it: no rows, no labels of its owner, no state."""
    half_deleted(whole, plan)
    again = submit(whole, campaign, 10, labels=LabelChange("bob"))
    assert again.campaign_id == plan.campaign_id
    assert (whole.survey(again).rows, read_labels(whole, again.campaign_id).owner) == (0, "bob")
    assert (state_of(whole, again.campaign_id)["state"], unfinished_deletions(whole)) == ("queued", [])
    finish_deletion(whole, again.campaign_id)
    assert whole.campaigns() == [again.campaign_id]


def test_who_comes_too_late_to_finish_it_leaves_the_new_one(whole, plan, campaign, monkeypatch):
    """Another process finishes it and plans the campaign anew before this one has the lease."""

    def hold_late(*words):
        monkeypatch.setattr(deleting, "hold_lease", hold_lease)
        submit(whole, campaign, 10)
        return hold_lease(*words)

    half_deleted(whole, plan)
    monkeypatch.setattr(deleting, "hold_lease", hold_late)
    finish_deletion(whole, plan.campaign_id)
    assert (whole.campaigns(), state_of(whole, plan.campaign_id)["state"]) == ([plan.campaign_id], "queued")
    assert LEASE not in whole.files.names(plan.campaign_id)


def test_a_folder_without_a_plan_is_not_a_deletion(store, plan):
    """A plan that was lost by accident can be restored: nothing removes the rows."""
    fill(store, plan)
    content = store.files.read(f"{plan.campaign_id}/{PLAN}")
    store.remove(plan.campaign_id, PLAN)
    finish_deletion(store, plan.campaign_id)
    assert unfinished_deletions(store) == []
    store.files.write(f"{plan.campaign_id}/{PLAN}", content)
    assert store.survey(plan).rows == 25


def test_a_living_coordinator_is_not_disturbed(whole, plan):
    """While a process holds the lease nothing is touched; who was taken over stops where he is."""
    before = whole.files.names(plan.campaign_id)
    with hold_lease(whole, plan.campaign_id), pytest.raises(LeaseHeld):
        delete_campaign(whole, plan.campaign_id)
    assert whole.files.names(plan.campaign_id) == before


def test_a_deletion_that_was_away_stops(whole, plan, monkeypatch):
    """Stopped for long, and another one has the lease: what may be a new campaign by now stays."""
    remove_tree = Files.remove_tree

    def away(self, name):
        remove_tree(self, name)
        whole.write_json(plan.campaign_id, LEASE, {"token": "theirs"})

    monkeypatch.setattr(Files, "remove_tree", away)
    with pytest.raises(LeaseLost):
        delete_campaign(whole, plan.campaign_id)
    assert len(whole.survey(plan).parts) == 3


@pytest.mark.processes
def test_a_coordinator_that_comes_too_late_writes_nothing(store, plan):
    """It had read the plan before the campaign was deleted: no folder is made again."""
    delete_campaign(store, plan.campaign_id)
    with pytest.raises(StoreError, match=r"plan\.json"):
        coordinate(open_store(store.url, HASTY), plan, Cluster(workers=1))
    assert store.files.names(plan.campaign_id) == []


DELETES = """
import sys, time
from campaign.coordinator.requests import delete_campaign
from campaign.store import open_store
from campaign.store.files.files import Files
remove_tree = Files.remove_tree
def slow(self, name):
    remove_tree(self, name)
    print(name, flush=True)
    time.sleep(600)
Files.remove_tree = slow
delete_campaign(open_store(sys.argv[1]), sys.argv[2])
"""


@pytest.mark.processes
def test_kill_of_the_process(whole, plan):
    """Kill -9 in the midst: on this machine the next one need not wait, and finishes."""
    command = [sys.executable, "-c", DELETES, whole.url, plan.campaign_id]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout.readline().startswith(plan.campaign_id)
        with pytest.raises(LeaseHeld):
            delete_campaign(whole, plan.campaign_id)
        os.kill(child.pid, signal.SIGKILL)
    assert (whole.campaigns(), unfinished_deletions(whole)) == ([], [plan.campaign_id])
    finish_deletion(whole, plan.campaign_id)
    assert whole.files.names("") == []
    assert take_lease(whole, plan.campaign_id)
