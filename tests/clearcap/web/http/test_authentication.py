"""Strangers: what they can learn, fill or slow down; and what stays of a request in log and audit trail."""

import dataclasses
import logging
from inspect import isasyncgenfunction, iscoroutinefunction

from clearcap.web.access import Role
from clearcap.web.http.authentication import authenticated, the_service
from clearcap.web.http.monitoring import MOST_OF_STRANGERS
from clearcap.web.http.responses import MEDIA_TYPE
from tests.clearcap.web.conftest import PASSWORD, URL, serving
from tests.clearcap.web.routes import all_ways

WRONG = {"Authorization": "Bearer clearcap_token_" + "x" * 43}


def test_wrong_tokens(client, service, as_user):
    """They are refused, after some with 429; who has a right one does not notice; the audit trail stays short.

    Ten thousand are sent to a process of its own, see `test_running_server`.
    """
    right = as_user("viewer")
    statuses = []
    for i in range(200):
        statuses.append(client.request("POST" if i % 2 else "GET", "/api/v1/tokens", headers=WRONG).status_code)
        if i % 50 == 0:
            assert client.get("/api/v1/account", headers=right).status_code == 200
    assert statuses == [401] * 5 + [429] * 195
    refused = client.get("/api/v1/account", headers=WRONG)
    assert int(refused.headers["retry-after"]) > 200
    assert len(service.audit.newest(count=1000)) == MOST_OF_STRANGERS


def test_writes_without_login(client, service):
    """They are refused and audited, but not without end."""
    for _ in range(MOST_OF_STRANGERS + 20):
        assert client.post("/api/v1/tokens", json={}).status_code == 401
    entries = service.audit.newest(count=1000)
    assert {(entry.who, entry.status) for entry in entries} == {("nobody", 401)}
    assert len(entries) == MOST_OF_STRANGERS


def test_wrong_passwords_do_not_fill_the_trail(client, service):
    for _ in range(MOST_OF_STRANGERS + 20):
        client.post("/login", data={"name": "viewer", "password": "wrong password"})
    assert len(service.audit.newest(count=1000)) == MOST_OF_STRANGERS


def test_body_of_a_stranger_is_not_read(client):
    """It is no JSON, which nobody finds out."""
    assert client.post("/api/v1/tokens", content=b"{" * 10**6).status_code == 401


def test_too_long_body_says_so(settings):
    """Also where the framework reads it, and would say only that it cannot."""
    small = dataclasses.replace(settings, limits=dataclasses.replace(settings.limits, body=1000))
    with serving(small) as (service, client):
        _, secret = service.tokens.add("admin", "x", Role.ADMIN, 60.0)
        headers = {"Authorization": f"Bearer {secret}", "Content-Type": "application/json"}
        answer = client.post("/api/v1/users", content=(b" " * 100 for _ in range(20)), headers=headers)
        assert (answer.status_code, answer.headers["connection"]) == (413, "close")
        assert "at most 1000 bytes" in answer.json()["detail"]
        assert service.audit.newest(count=1)[0].status == 413


def test_two_hosts(client):
    answer = client.get("/healthz", headers=[("Host", "localhost"), ("Host", "evil.example")])
    assert answer.status_code == 421


def test_bug_is_answered_recorded_and_audited(client, service, browse, monkeypatch, caplog):
    """By 500 with all headers; the answer says nothing of it, the log all."""

    def broken(*_, **__):
        raise RuntimeError("a very odd number")

    monkeypatch.setattr(service.users, "add", broken)
    answer = client.post("/api/v1/users", json={"name": "x", "role": "viewer"}, headers=browse("admin"))
    assert (answer.status_code, answer.headers["content-type"]) == (500, MEDIA_TYPE)
    assert "content-security-policy" in answer.headers
    assert "odd number" not in answer.text
    assert answer.headers["x-request-id"] in answer.text
    assert "RuntimeError: a very odd number" in caplog.text
    assert [(e.who, e.status) for e in service.audit.newest(count=1)] == [("admin", 500)]


def test_store_that_cannot_be_read(client, service, monkeypatch, caplog):
    """Whoever asks does not learn where it is."""

    def broken(*_, **__):
        raise OSError("/secret/place")

    monkeypatch.setattr(type(service.store), "folders", broken)
    answer = client.get("/readyz")
    assert (answer.status_code, "/secret/place" in answer.text) == (503, False)
    assert "/secret/place" in caplog.text


def test_no_secret_in_log_or_trail(client, service, reported, browse, as_user, caplog):
    """Of logins, sessions, tokens, links and shared links; also where they are sent to the wrong place."""
    caplog.set_level(logging.DEBUG)
    service.users.change("viewer", password=PASSWORD)
    secrets = [PASSWORD, "wrong password", "typed into the wrong field"]
    client.post("/login", data={"name": "viewer", "password": PASSWORD})
    secrets += client.cookies.values()
    client.post("/login", data={"name": "viewer", "password": "wrong password"})
    client.post("/login", data={"name": "typed into the wrong field", "password": "x"})
    client.cookies.clear()
    page = browse("admin")
    secrets.append(page["x-csrf-token"])
    made = client.post("/api/v1/tokens", json={"name": "ci", "role": "viewer"}, headers=page).json()["secret"]
    link = client.post("/api/v1/users/viewer/login-link", headers=page).json()["link"]
    shared = client.post(f"/api/v1/campaigns/{reported}/shares", json={}, headers=page).json()["link"]
    secrets += client.cookies.values()
    client.cookies.clear()
    for url in (link, shared):
        path = url.partition(":8700")[2]
        for method in ("POST", "DELETE", "GET", "HEAD", "GET"):
            client.request(method, path, headers={"Origin": URL})
    client.get("/api/v1/account", headers={"Authorization": f"Bearer {made}"})
    client.get("/api/v1/account", headers={"Authorization": f"Bearer {made}x"})
    client.delete(f"/api/v1/tokens/{made}", headers=page)
    client.patch(f"/api/v1/users/{made}", json={}, headers=as_user("admin"))
    secrets += [made, link.partition("key=")[2], shared.rpartition("/")[2], *client.cookies.values()]
    assert len(set(secrets)) > 8
    trail = "\n".join(str(vars(entry)) for entry in service.audit.newest(count=1000))
    # what the browser of this test logs of its own requests is not the server's
    lines = [line for line in caplog.text.splitlines() if "https://localhost/" not in line]
    assert "clearcap.requests" in caplog.text
    for text in (*lines, trail, client.get("/metrics", headers=as_user("viewer")).text):
        assert [secret for secret in secrets if secret in text] == []


def test_no_dependency_takes_a_thread():
    """FastAPI calls what is no coroutine in a thread: when all threads wait for a store, nobody could even be known."""
    calls = {call for way in all_ways() for call in way.calls}
    assert {authenticated, the_service} < calls
    kinds = iscoroutinefunction, isasyncgenfunction
    assert [each for each in calls if not any(kind(f) for kind in kinds for f in (each, type(each).__call__))] == []
