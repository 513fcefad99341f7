"""The log of requests: one JSON document a line, on standard error."""

import asyncio
import io
import json
import logging
from contextlib import asynccontextmanager
from types import SimpleNamespace

import pytest
from prometheus_client import CollectorRegistry
from prometheus_client.parser import text_string_to_metric_families

from campaign.coordinator.state import write_state
from campaign.errors import StoreError
from clearcap.web.http.monitoring import Record, ServiceGauges, logger, show_requests
from clearcap.web.index import CampaignIndex
from clearcap.web.jobs.pool import JobPool, Quota
from clearcap.web.watcher import Watcher
from tests.clearcap.web.conftest import read_all
from tests.clearcap.web.jobs import strange_jobs
from tests.clearcap.web.running import until_true


@pytest.fixture
def shown():
    """Return what the log is written to, as the server writes it."""
    before, stream = (logger.handlers, logger.propagate, logger.level), io.StringIO()
    show_requests(stream)
    yield stream
    logger.handlers, logger.propagate = before[:2]
    logger.setLevel(before[2])


def test_each_request_is_a_line(client, shown):
    """Also what a browser sends to steer a terminal is one line of plain letters."""
    client.get("/healthz")
    client.request("GET", "/%1b[2J%0Anew line")
    lines = [json.loads(line) for line in shown.getvalue().splitlines()]
    assert [(line["route"], line["status"], line["who"]) for line in lines] == [
        ("/healthz", 200, "nobody"),
        ("none", 404, "nobody"),
    ]


def test_write_that_cannot_be_audited_is_not_answered_as_done(client, service, as_user, shown, monkeypatch):
    """The disk is full: whoever asked is told, and may try again."""

    def full(*_, **__):
        raise StoreError("service.sqlite: cannot be used now (database or disk is full)")

    headers = as_user("admin")
    monkeypatch.setattr(service.audit, "add", full)
    answer = client.post("/api/v1/users", json={"name": "bob", "role": "viewer"}, headers=headers)
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "10")
    assert "disk is full" in answer.json()["detail"]
    assert "Traceback" not in shown.getvalue()


def test_server_that_ends_says_so_to_whoever_waits():
    """A request that waits longer than the server does is cancelled: that is no bug of the server."""
    sent = []

    async def waits(scope, receive, send):
        await asyncio.Event().wait()

    async def send(message):
        sent.append(message)

    async def ended():
        scope = {"type": "http", "method": "POST", "path": "/api/v1/users", "headers": [], "state": {}}
        request = asyncio.create_task(Record(waits, None, None)(scope, None, send))
        await asyncio.sleep(0)
        request.cancel()
        await request

    asyncio.run(ended())
    begin, body = sent
    assert begin["status"] == 503
    assert (b"retry-after", b"10") in begin["headers"]
    assert b"the server ends" in body["body"]


def test_bug_is_one_line(client, service, shown, monkeypatch):
    """With its traceback; a terminal obeys nothing of it."""

    def broken(*_, **__):
        raise RuntimeError("\x1b[2J")

    monkeypatch.setattr(service.database, "row", broken)
    assert client.get("/readyz").status_code == 500
    bug, answered = map(json.loads, shown.getvalue().splitlines())
    assert bug["request"] == answered["request"]
    assert bug["bug"].endswith("RuntimeError: \x1b[2J\n")
    assert logging.getLogger("clearcap.requests") is logger


def test_client_that_goes_in_the_middle_of_a_body_is_no_bug(client, as_user, shown):
    """It is a line of its own status, and no error that calls somebody at night."""
    headers = [(name.lower().encode(), value.encode()) for name, value in as_user("engineer").items()]
    scope = {"type": "http", "method": "POST", "path": "/api/v1/checks/mechanism", "raw_path": b"", "query_string": b""}
    scope |= {
        "headers": [*headers, (b"host", client.base_url.netloc), (b"content-type", b"application/json")],
        "state": {},
    }
    scope |= {
        "scheme": "http",
        "server": (client.base_url.host, 80),
        "client": ("127.0.0.1", 50000),
        "http_version": "1.1",
    }
    told = iter([{"type": "http.request", "body": b'{"text": "', "more_body": True}])

    async def receive():
        return next(told, {"type": "http.disconnect"})

    async def send(message):
        pass

    client.portal.call(client.app, scope, receive, send)
    (line,) = map(json.loads, shown.getvalue().splitlines())
    assert (line["route"], line["status"]) == ("/api/v1/checks/mechanism", 499)


@pytest.fixture
def counted(store, tmp_path):
    """Return what opens a watcher, a pool of one process, and what reads a gauge."""

    @asynccontextmanager
    async def opened():
        index, registry = CampaignIndex(tmp_path / "index.sqlite"), CollectorRegistry()
        watcher = Watcher(store, index)
        async with JobPool(1, quota=Quota(at_once=1)) as pool:
            registry.register(
                ServiceGauges(SimpleNamespace(watcher=watcher, pool=pool, workload=None, free_space=lambda: None))
            )
            yield watcher, pool, lambda name, **state: registry.get_sample_value(name, state)
        index.close()

    return opened


async def _until(name, count, value, **state):
    """Wait until a gauge has a value."""
    await until_true(lambda: value(name, **state) == count, f"{name} {state} is {count}")


@pytest.mark.processes
def test_campaigns_by_state(store, plan, counted):
    """A state that no campaign has any more is zero, not gone."""

    async def count():
        async with counted() as (watcher, _, value):
            assert value("clearcap_campaigns", state="queued") == 0
            for state, other in (("queued", "cancelled"), ("cancelled", "queued")):
                write_state(store, plan.campaign_id, state)
                read_all(watcher.index, store)
                assert value("clearcap_campaigns", state=state) == 1
                assert value("clearcap_campaigns", state=other) == 0

    asyncio.run(count())


@pytest.mark.processes
def test_jobs_that_run_and_wait(counted):
    async def count():
        async with counted() as (_, pool, value):
            jobs = [asyncio.create_task(pool.run("eva", strange_jobs.sleep, 600)) for _ in range(3)]
            await _until("clearcap_jobs", 1, value, state="running")
            assert value("clearcap_jobs", state="waiting") == 2
            for left in (1, 0):
                jobs.pop().cancel()
                await _until("clearcap_jobs", left, value, state="waiting")
            jobs.pop().cancel()
            await _until("clearcap_jobs", 0, value, state="running")

    asyncio.run(count())


@pytest.mark.processes
def test_open_event_streams(store, plan, counted):
    write_state(store, plan.campaign_id, "queued")

    async def count():
        async with counted() as (watcher, _, value):
            streams = [watcher.follow(plan.campaign_id) for _ in range(3)]
            for number, stream in enumerate(streams):
                assert value("clearcap_event_streams") == number
                await anext(stream)
            for left in (2, 1, 0):
                await streams[left].aclose()
                assert value("clearcap_event_streams") == left

    asyncio.run(count())


def test_all_that_is_declared_is_counted(client, service, reported, as_user):
    """No gauge of the page stands without a value, and each changes with what the server does."""

    def page():
        text = client.get("/metrics", headers=as_user("viewer")).text
        families = {each.name: each for each in text_string_to_metric_families(text)}
        assert all(each.samples for name, each in families.items() if not name.startswith("clearcap_request"))
        return families

    def campaigns(state):
        return sum(each.value for each in page()["clearcap_campaigns"].samples if each.labels["state"] == state)

    def listings():
        return sum(each.value for each in page()["clearcap_requests"].samples if "campaigns" in each.labels["route"])

    assert {name for name in page() if not name.startswith("process_")} == {
        "clearcap_requests",
        "clearcap_request_seconds",
        "clearcap_campaigns",
        "clearcap_jobs",
        "clearcap_event_streams",
        "clearcap_store_up",
        "clearcap_store_free_bytes",
        "clearcap_coordinator_up",
        "clearcap_workers",
        "clearcap_rows_per_second",
        "clearcap_waiting",
    }
    before = listings()
    for state in ("completed", "failed"):
        write_state(service.store, reported, state)
        service.watcher.hurry()
        client.get("/api/v1/campaigns", headers=as_user("viewer"))
        assert campaigns(state) == 1
    assert listings() > before
    assert client.get("/metrics").status_code == 401
