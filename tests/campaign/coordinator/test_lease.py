"""Who drives a campaign: one process at a time, and the next one when it is gone."""

import json
import os
import subprocess
import sys

import pytest

import campaign.coordinator.lease as leases
from campaign.coordinator.lease import (
    HEARTBEAT_INTERVAL,
    STALE_AFTER,
    LeaseHeld,
    hold_lease,
    is_alive,
    is_coordinated,
    judge_life,
    lease_holder,
    take_lease,
    this_process,
)
from campaign.processes import started
from campaign.store import open_store
from campaign.store.layout import LEASE
from tests.until import until

HELD = """
import sys, time
from campaign.coordinator.lease import hold_lease
from campaign.processes import started
from campaign.store import open_store
with hold_lease(open_store(sys.argv[1]), "demo"):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def store(tmp_path):
    """Return a store with a folder for the campaign."""
    (tmp_path / "demo").mkdir()
    return open_store(str(tmp_path))


@pytest.fixture
def other(store):
    """Return a process that holds the lease."""
    child = subprocess.Popen([sys.executable, "-c", HELD, store.url], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "held\n"
    yield child
    child.kill()
    child.wait()
    child.stdout.close()


def test_an_interrupt_while_it_is_taken_leaves_nothing(store, monkeypatch):
    """It comes once the file is there, and before whoever wrote it knows."""
    create = store.create_json

    def interrupted(*content):
        assert create(*content)
        raise KeyboardInterrupt

    monkeypatch.setattr(store, "create_json", interrupted)
    with pytest.raises(KeyboardInterrupt), hold_lease(store, "demo"):
        pass
    assert lease_holder(store, "demo") is None


def test_held_and_given_back(store):
    """Inside the block nobody else gets it; after it anybody."""
    with hold_lease(store, "demo") as token:
        assert lease_holder(store, "demo") == token
        assert is_coordinated(store, "demo")
        with pytest.raises(LeaseHeld, match=f"process {os.getpid()}"):
            take_lease(store, "demo")
    assert lease_holder(store, "demo") is None
    assert not is_coordinated(store, "demo")


@pytest.mark.processes
def test_killed_holder_is_known_at_once(store, other):
    """Kill -9 of the holder on this machine: the next one need not wait, not even for its parent to notice."""
    with pytest.raises(LeaseHeld):
        take_lease(store, "demo")
    other.kill()
    until(lambda: started(other.pid) is None, "the holder still runs")
    assert not is_coordinated(store, "demo")
    slept = []
    take_lease(store, "demo", pause=slept.append)
    assert slept == [leases.RACE_WAIT]


def test_number_used_again_is_another_process(store):
    """A living process of the same number, but started later, does not hold it."""
    store.write_json("demo", LEASE, {"token": "x", **this_process(), "started": "1"})
    assert not is_coordinated(store, "demo")
    with hold_lease(store, "demo"):
        pass


@pytest.fixture
def elsewhere(store):
    """Put a lease of another machine into the store."""
    store.write_json("demo", LEASE, {"token": "x", **this_process(), "host": "another machine"})


class Time:
    """A clock that only pauses turn, in each of which something may happen."""

    def __init__(self, meanwhile=lambda: None):
        self.now, self._meanwhile = 1000.0, meanwhile

    def clock(self):
        """Return the time."""
        return self.now

    def pause(self, seconds):
        """Let time pass."""
        self.now += seconds
        self._meanwhile()


def test_holder_elsewhere_lives_by_its_heartbeat(store, elsewhere):
    """With a heartbeat that changes it holds the lease, whatever its clock says; without one for long it does not."""
    beats = []

    def beat():
        beats.append(len(beats))
        store.write_json("demo", "heartbeat.json", {"beat": len(beats), "time": 4e9})

    beating, silent = Time(beat), Time()
    with pytest.raises(LeaseHeld):
        take_lease(store, "demo", beating.clock, beating.pause)
    assert not is_alive(store, "demo", store.read_json("demo", LEASE), silent.clock, silent.pause)
    assert STALE_AFTER <= silent.now - 1000.0 <= STALE_AFTER + HEARTBEAT_INTERVAL
    token = take_lease(store, "demo", silent.clock, silent.pause)
    assert lease_holder(store, "demo") == token


def test_of_two_who_take_a_stale_one_at_once_one_gets_it(store, elsewhere):
    """The other one writes its token in between: this one lets go."""

    def write_theirs():
        if store.read_json("demo", LEASE)["token"] != "x":  # this one has written its own
            store.write_json("demo", LEASE, {"token": "theirs"})

    lets_go = Time(write_theirs)
    with pytest.raises(LeaseHeld, match="at the same time"):
        take_lease(store, "demo", lets_go.clock, lets_go.pause)


def test_lease_taken_over_is_not_removed(store):
    """Who lost it leaves the other's."""
    with hold_lease(store, "demo"):
        store.write_json("demo", LEASE, {"token": "theirs"})
    assert json.loads(store.files.read("demo/lease.json"))["token"] == "theirs"


def test_life_is_judged_without_waiting(store, elsewhere):
    """Whoever looks keeps what it saw; another lease, or none, begins anew."""

    def judged(earlier, now):
        return judge_life(store.read_json("demo", LEASE), store.read_json("demo", "heartbeat.json"), earlier, now)

    first = judged(None, 0.0)
    assert (first.token, first.is_alive) == ("x", None)
    assert judged(first, STALE_AFTER - 0.1) == first
    assert judged(first, STALE_AFTER).is_alive is False
    store.write_json("demo", "heartbeat.json", {"beat": 1})
    alive = judged(first, 90.0)
    assert (alive.is_alive, alive.seen_at) == (True, 90.0)
    lease = store.read_json("demo", LEASE)
    assert judge_life({**lease, "token": "y"}, alive.heartbeat, alive, 91.0).is_alive is None
    assert judge_life(None, alive.heartbeat, alive, 91.0).is_alive is False
    mine = {"token": "z", **this_process()}
    assert judge_life(mine, None, None, 0.0).is_alive
    assert judge_life({**mine, "started": "1"}, None, None, 0.0).is_alive is False
