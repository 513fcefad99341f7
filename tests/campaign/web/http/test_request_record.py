"""The log of requests: one JSON document a line, on standard error."""

import io
import json
import logging

import pytest

from campaign.errors import StoreError
from campaign.web.http.request_record import logger, show_requests


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
