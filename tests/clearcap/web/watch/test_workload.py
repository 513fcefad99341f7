"""What is computed now and what waits, as the files of the store say it."""

import os
import re
import socket
from dataclasses import replace

import httpx
import psutil
import pytest

from campaign.coordinator.heartbeat import Heartbeat
from campaign.coordinator.lease import beating, hold_lease, this_process
from campaign.coordinator.state import write_state
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.layout import HEARTBEAT, LEASE, SERVICE
from clearcap.web.index import entry_of
from clearcap.web.watcher import look_at_work
from tests.campaign.conftest import SPEC
from tests.clearcap.web.running import PATIENCE, Served
from tests.until import until

BEAT = Heartbeat("", "running", 25, 10, 10, 0, 15, {"ok": 10}, 5.0, 3.0, 4, pid=12)
ELSEWHERE = {"token": "t", "name": "node-7", "host": "another boot", "pid": 99, "started": "1"}


@pytest.fixture
def queued(storage, tmp_path):
    """Return a store and what makes a queued campaign of a name."""
    store = open_store(storage(tmp_path))

    def make(name):
        file = tmp_path / f"{name}.toml"
        file.write_text(SPEC.replace('"demo"', f'"{name}"'))
        return submit(store, load_campaign(str(file)), 10).campaign_id

    return store, make


def look(store, earlier=None):
    """Look at all campaigns of a store."""
    return look_at_work(store, [entry_of(store, each) for each in store.campaigns()], earlier)


def test_nobody_serves(queued):
    """Campaigns wait in the order of their ids, which is that of the coordinator; what is over is not shown."""
    store, make = queued
    later, sooner, over = make("b"), make("a"), make("c")
    write_state(store, over, "cancelled")
    work = look(store)
    assert (work.serving, work.running, work.workers) == (None, [], 0)
    assert [each.entry.campaign for each in work.waiting] == [sooner, later]


def test_processes_of_this_machine(queued):
    """Who serves and who coordinates is alive while it holds its lease, and is named."""
    store, make = queued
    running, waiting = make("a"), make("b")
    with hold_lease(store, SERVICE), beating(store, SERVICE), hold_lease(store, running):
        write_state(store, running, "running")
        store.write_json(running, HEARTBEAT, replace(BEAT, campaign=running).to_json())
        until(lambda: store.read_json(SERVICE, HEARTBEAT), "a heartbeat")
        work = look(store)
        assert (work.serving.pid, work.serving.machine) == (str(os.getpid()), socket.gethostname())
        assert work.serving.sign.is_alive is True
        assert work.serving.seconds >= 2.0
        (one,) = work.running
        assert (one.entry.campaign, one.pid, one.machine) == (running, str(os.getpid()), socket.gethostname())
        assert (work.workers, one.seen.heartbeat.left) == (4, 15)
        assert [each.entry.campaign for each in work.waiting] == [waiting]
    again = look(store)
    assert (again.serving, again.running) == (None, [])
    assert [(each.entry.campaign, each.seen.state) for each in again.waiting] == [
        (running, "interrupted"),
        (waiting, "queued"),
    ]


def test_a_process_elsewhere_is_judged_by_two_looks(queued):
    store, make = queued
    make("a")
    store.write_json(SERVICE, LEASE, ELSEWHERE)
    store.write_json(SERVICE, HEARTBEAT, {"beat": 30, "time": 0.0})
    first = look(store)
    assert (first.serving.machine, first.serving.seconds, first.serving.sign.is_alive) == ("node-7", 60.0, None)
    store.write_json(SERVICE, HEARTBEAT, {"beat": 31, "time": 2.0})
    assert look(store, first).serving.sign.is_alive is True


def test_a_process_that_died_is_seen(queued):
    store, make = queued
    make("a")
    store.write_json(SERVICE, LEASE, {"token": "t", **this_process(), "started": "another process of this number"})
    assert look(store).serving.sign.is_alive is False


@pytest.mark.parametrize("odd", [{}, {"pid": "<b>" * 100, "name": None}, {"pid": [1], "name": {"a": 1}}])
def test_odd_leases(queued, odd):
    """A lease that clearcap never wrote is shown, at most so long."""
    store, make = queued
    make("a")
    store.write_json(SERVICE, LEASE, odd)
    store.write_json(SERVICE, HEARTBEAT, {"beat": "x"})
    serving = look(store).serving
    assert serving.seconds is None
    assert len(serving.pid) <= 20


@pytest.mark.processes
@pytest.mark.slow
def test_page_of_a_server_at_work(tmp_path):
    """The page of the administration names the process that computes, its worker, and what waits behind it."""
    store = open_store(str(tmp_path / "runs"))
    for name, samples in (("a", 20_000), ("b", 100)):
        file = tmp_path / f"{name}.toml"
        file.write_text(SPEC.replace('"demo"', f'"{name}"'))
        submit(store, load_campaign(str(file), samples=samples), 10)
    with Served(tmp_path, "--workers", "1").wait() as server:
        headers = server.token()
        text = until(lambda: _page_at_work(server, headers), server.said)
        pid = int(re.search(r"process (\d+) on \S+,\s*<span class=\"good\">alive", text)[1])
        assert "coordinate" in psutil.Process(pid).cmdline()
        assert psutil.Process(pid).ppid() == server.process.pid
        running, _, waiting = text.partition("Waiting campaigns")
        assert f"process {pid} on" in running.partition("Running campaigns")[2]
        assert re.search(r"<th scope=\"row\"><a href=\"/campaigns/b-\w+\">", waiting)


def _page_at_work(server, headers):
    """Return the page once a worker computes."""
    text = httpx.get(f"{server.url}/admin/system", headers=headers, timeout=PATIENCE).text
    return text if re.search(r"<dt>Workers that compute</dt><dd>1</dd>", text) else None
