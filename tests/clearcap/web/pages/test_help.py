"""The page of help: every call that the API has, with who may ask."""

import re

import pytest
from fastapi.testclient import TestClient

from clearcap.web import server
from clearcap.web.pages import login
from tests.clearcap.web.conftest import URL
from tests.clearcap.web.pages.forms import Page


def test_every_call_is_listed(client):
    """A stranger may read it; each method and path of the document is a row."""
    text = client.get("/help").text
    listed = set(re.findall(r"<code>([A-Z]+ /[^<]*)</code>", text))
    paths = client.get("/api/v1/openapi.json").json()["paths"]
    assert listed == {f"{method.upper()} {path}" for path, methods in paths.items() for method in methods}
    assert len(listed) > 30
    assert Page(text).faults == []


@pytest.mark.parametrize(
    ("method", "path", "who"),
    [
        ("get", "/healthz", "anybody"),
        ("get", "/api/v1/campaigns/{campaign}", "viewer, or a shared link"),
        ("get", "/api/v1/mechanisms", "viewer"),
        ("post", "/api/v1/campaigns", "engineer"),
        ("post", "/api/v1/campaigns/{campaign}/signoffs", "approver"),
        ("post", "/api/v1/users", "admin"),
    ],
)
def test_who_may_is_what_is_checked(client, method, path, who):
    """The document says of each call what its own dependencies check."""
    assert client.get("/api/v1/openapi.json").json()["paths"][path][method]["x-who-may"] == who


def test_documentation_where_it_is_built(service, tmp_path, monkeypatch):
    """A server that has the site links to it and shows it; one that has none does neither."""
    site = tmp_path / "site"
    monkeypatch.setattr(server, "SITE", site)
    monkeypatch.setattr(login, "SITE", site)
    assert "/help/documentation" not in TestClient(server.make_app(service), base_url=URL).get("/help").text
    site.mkdir()
    (site / "index.html").write_text("<h1>Tutorials</h1>")
    client = TestClient(server.make_app(service), base_url=URL)
    [address] = re.findall(r'href="(/help/documentation[^"]*)"', client.get("/help").text)
    shown = client.get(address)
    assert shown.text == "<h1>Tutorials</h1>"
    assert "script-src 'self'" in shown.headers["Content-Security-Policy"]


def test_who_is_logged_in_is_shown(client, browse):
    """The page shows who asks, as all pages do."""
    assert "Log out" not in client.get("/help").text
    browse("viewer")
    assert "Log out" in client.get("/help").text
