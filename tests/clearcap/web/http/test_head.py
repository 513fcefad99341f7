"""HEAD is answered with the head of GET, and does nothing."""

import pytest

from tests.clearcap.web.running import exchange, in_a_thread
from tests.each import each
from tests.until import until


@each(
    "path",
    [
        "/healthz",
        "/metrics",
        "/login",
        "/static/pages.css",
        "/api/v1/openapi.json",
        "/api/v1/campaigns",
        "/campaigns",
        "/api/v1/mechanisms",
        "/api/v1/nothing",
        "/api/v1/campaigns?limit=none",
    ],
)
def test_head_of_get(client, as_user, path):
    """The same status and headers, of answers and of refusals, and no body."""
    headers = as_user("viewer")
    asked, got = client.head(path, headers=headers), client.get(path, headers=headers)
    assert (asked.status_code, asked.content) == (got.status_code, b"")
    for name in ("content-type", "etag", "allow", "location", "cache-control"):
        assert asked.headers.get(name) == got.headers.get(name)
    if path != "/metrics":  # which counts these requests
        assert asked.headers.get("content-length") == got.headers.get("content-length")


def test_head_is_recorded_as_such(client, caplog):
    """With its own method and its route."""
    caplog.set_level("INFO", "clearcap.requests")
    client.head("/healthz")
    assert '"method": "HEAD", "route": "/healthz", "status": 200' in caplog.text


def test_head_needs_a_login_too(client):
    assert client.head("/api/v1/campaigns").status_code == 401


def test_head_of_what_is_only_posted(client, as_user):
    answer = client.head("/api/v1/checks/campaign", headers=as_user("engineer"))
    assert (answer.status_code, answer.headers["allow"]) == (405, "POST")


def test_head_uses_no_link(client, service):
    """A program that looks at a one-time link, as mail servers do, does not log in by it."""
    key = service.sessions.new_link("viewer")
    assert client.head(f"/login/link?key={key}").status_code == 405
    typed = client.get(f"/login/link?key={key}", headers={"Sec-Fetch-Site": "none"})
    assert "clearcap" in typed.headers["set-cookie"]


@pytest.mark.processes
def test_head_of_events_ends(settings, campaign, plan):
    """The stream has no end; its head has, on the same connection as the next request."""
    with in_a_thread(settings) as (service, port):
        service.store.create_plan(plan)
        secret = service.tokens.add("viewer", "test", service.users.get("viewer").role, 3600.0)[1]
        head = f"HEAD /api/v1/campaigns/{plan.campaign_id}/events HTTP/1.1\r\nHost: localhost\r\n"
        head += f"Authorization: Bearer {secret}\r\n\r\n"
        last = "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"
        answer = exchange(port, head.encode(), last.encode())
        assert answer.count(b"HTTP/1.1 200") == 2
        assert b"text/event-stream" in answer
        assert b"retry:" not in answer
        until(lambda: service.streams["viewer"] == 0, "no stream is open")
