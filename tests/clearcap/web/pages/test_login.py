"""Log in by password, one-time link and shared link; and what another site's page cannot do."""

import re

import pytest

from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE, SHARE_COOKIE
from clearcap.web.pages.login import own_path
from tests.clearcap.web.conftest import PASSWORD, URL
from tests.each import each


@pytest.fixture
def eva(service):
    return service.users.add("eva", Role.ENGINEER, PASSWORD)


def _log_in(client, name="eva", password=PASSWORD, **headers):
    return client.post("/login", data={"name": name, "password": password}, headers=headers)


def test_password_begins_a_session(client, eva):
    answer = _log_in(client)
    assert answer.status_code == 200
    cookie = answer.headers["set-cookie"]
    assert cookie.startswith(f"{COOKIE}=clearcap_session_")
    for part in ("HttpOnly", "Secure", "SameSite=strict", "Path=/"):
        assert part in cookie
    assert "Domain" not in cookie


def test_log_out(client, eva):
    _log_in(client)
    csrf = re.search(r'name="csrf" value="([^"]+)"', client.get("/nowhere", headers={"Accept": "text/html"}).text)
    assert csrf is None  # who is not asked for is not shown
    secret = client.cookies[COOKIE]
    answer = client.post("/logout", data={"csrf": client.app.state.service.sessions.principal(secret).csrf})
    assert (answer.status_code, answer.headers["location"]) == (303, "/login")
    assert client.app.state.service.sessions.principal(secret) is None


def test_wrong_password(client, service, eva):
    answer = _log_in(client, password="wrong password")
    assert answer.status_code == 401
    assert "do not belong together" in answer.text
    assert "set-cookie" not in answer.headers
    assert (service.audit.newest()[0].who, service.audit.newest()[0].status) == ("eva", 401)


def test_guessing_is_slowed_down(client, eva):
    statuses = [_log_in(client, password=f"guess number {i}").status_code for i in range(6)]
    assert statuses == [401] * 5 + [429]
    answer = _log_in(client)
    assert answer.status_code == 429  # also with the right one
    assert int(answer.headers["retry-after"]) > 200


def test_login_from_another_site_is_refused(client, eva):
    for headers in ({"Origin": "https://evil.example"}, {"Origin": "null"}, {"Sec-Fetch-Site": "cross-site"}):
        assert _log_in(client, **headers).status_code == 403
    assert _log_in(client, Origin=URL).status_code == 200


def test_link(client, service, eva):
    key = service.sessions.new_link("eva")
    answer = client.get(f"/login/link?key={key}&next=/mechanisms", headers={"Sec-Fetch-Site": "none"})
    assert 'content="0; url=/mechanisms"' in answer.text
    assert service.sessions.principal(client.cookies[COOKIE]).name == "eva"
    assert client.get(f"/login/link?key={key}").status_code == 403


def test_shared_link(client, service, eva):
    _, secret = service.tokens.share("demo-1", "eva", "", 60.0)
    assert "url=/campaigns/demo-1" in client.get(f"/shared/{secret}").text
    assert service.sessions.principal(client.cookies[SHARE_COOKIE]).campaign == "demo-1"
    assert client.get("/shared/clearcap_share_x").status_code == 403


def test_shared_link_ends_nobody_s_session(client, service, eva):
    """Who is logged in stays it, and sees the campaign as himself; logging out ends both."""
    _log_in(client)
    _, secret = service.tokens.share("demo-1", "eva", "", 60.0)
    client.get(f"/shared/{secret}")
    assert client.get("/api/v1/account").json()["name"] == "eva"
    client.post("/logout", data={"csrf": service.sessions.principal(client.cookies[COOKIE]).csrf})
    assert client.get("/api/v1/account").status_code == 401
    client.get(f"/shared/{secret}")
    refused = client.get("/campaigns", headers={"Accept": "text/html"})
    assert (refused.status_code, '<a href="/login">Log in</a>' in refused.text) == (403, True)


def test_who_is_not_logged_in_comes_back_after_it(client):
    answer = client.get("/login", params={"next": "/campaigns?tag=a&sort=cpk"})
    assert '<input type="hidden" name="next" value="/campaigns?tag=a&amp;sort=cpk">' in answer.text


@each(
    "wanted",
    [
        "https://evil.example",
        "//evil.example",
        "/\\evil.example",
        "evil",
        "javascript:alert(1)",
        "/a\nb",
        "",
        "//[",
        "http://[",
    ],
)
def test_login_leads_nowhere_else(wanted):
    assert own_path(wanted) == "/campaigns"


def test_icon_of_what_is_no_page(client):
    """A browser asks for it where it shows an answer of the API, to nobody too."""
    answer = client.get("/favicon.ico", follow_redirects=True)
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/svg+xml")
