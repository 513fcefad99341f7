"""The pages of the own account, of admins, and of a campaign's links and sign-offs, without scripts."""

import re

import pytest

from clearcap.web.access import Role
from tests.clearcap.web.conftest import PASSWORD, URL
from tests.clearcap.web.pages.forms import Page
from tests.each import each

NEW = "another long password"


@pytest.fixture
def visit(client, service, browse):
    """Return what opens a page as a user of a role, checks what every page must be, and returns it."""

    def opened(path, role=None):
        if role:
            browse(role)
        answer = client.get(path, headers={"Accept": "text/html"})
        assert answer.status_code == 200, answer.text
        seen = Page(answer.text)
        assert seen.faults == []
        return answer.text, seen

    return opened


@pytest.fixture
def submit(client):
    """Return what submits a form of a page as a browser without scripts does."""

    def sent(seen, action, **fields):
        data = {**seen.form(action), **fields}
        return client.post(action, data=data, headers={"Origin": URL, "Accept": "text/html"})

    return sent


@pytest.fixture
def home(reported, service):
    return f"/campaigns/{reported}"


def secret_of(text):
    return re.search(r'<code class="secret" tabindex="0">([^<]+)</code>', text)[1]


@pytest.mark.parametrize("path", ["/account", "/admin", "/admin/tokens", "/admin/audit", "/admin/system"])
def test_pages_of_an_admin(visit, path):
    visit(path, "admin")


@pytest.mark.parametrize("path", ["/admin", "/admin/tokens", "/admin/audit", "/admin/system"])
def test_pages_for_admins_only(client, browse, path):
    browse("approver")
    assert client.get(path).status_code == 403
    client.cookies.clear()
    answer = client.get(path, headers={"Accept": "text/html"})
    assert (answer.status_code, answer.headers["location"]) == (303, f"/login?next={path.replace('/', '%2F')}")


def test_token_is_shown_once(client, service, visit, submit):
    _, seen = visit("/account", "engineer")
    answer = submit(seen, "/account/tokens", name="<b>nightly</b>", role="viewer", days="7")
    secret = secret_of(answer.text)
    assert service.tokens.principal(secret).role is Role.VIEWER
    assert "<b>nightly" not in answer.text
    text, seen = visit("/account")
    assert secret not in text
    assert submit(seen, "/account/tokens/1/revoke").status_code == 303
    assert service.tokens.principal(secret) is None
    assert submit(Page(answer.text), "/account/tokens", name="x", role="admin").status_code == 403


def test_password_and_sessions(client, service, visit, submit):
    other = service.sessions.begin("engineer")
    _, seen = visit("/account", "engineer")
    assert "present" not in seen.form("/account/password")  # there is none yet
    assert submit(seen, "/account/password", password=NEW, again="another").status_code == 422
    assert submit(seen, "/account/password", password="short", again="short").status_code == 422
    answer = submit(seen, "/account/password", password=NEW, again=NEW)
    assert "url=/account" in answer.text
    assert service.sessions.principal(other) is None
    _, seen = visit("/account")  # this browser got a new session
    assert submit(seen, "/account/password", present=PASSWORD, password=NEW, again=NEW).status_code == 403
    assert submit(seen, "/account/sessions/end").headers["location"] == "/login"
    assert service.sessions.count("engineer") == 0


def test_users(client, service, visit, submit):
    """An admin adds a user, hands on his link, changes and disables him."""
    _, seen = visit("/admin", "admin")
    answer = submit(seen, "/admin/users", name="eva", role="engineer")
    link = secret_of(answer.text)
    assert Page(answer.text).faults == []
    _, seen = visit("/admin")
    assert submit(seen, "/admin/users/eva/role", role="approver").status_code == 303
    assert submit(seen, "/admin/users/eva/password", password=NEW).status_code == 303
    assert service.users.by_password("eva", NEW).role is Role.APPROVER
    assert client.get(link.partition(":8700")[2]).status_code == 403  # a password was set since
    answer = submit(seen, "/admin/users/eva/link")
    assert service.sessions.use_link(secret_of(answer.text).partition("key=")[2]) == "eva"
    assert submit(seen, "/admin/users/eva/disabled", disabled="true").status_code == 303
    assert service.users.get("eva").is_disabled
    assert "eva" in visit("/admin/audit?object=eva")[0]
    assert submit(seen, "/admin/users/admin/role", role="viewer").status_code == 409


def test_admin_revokes_tokens(service, visit, submit):
    token, secret = service.tokens.add("viewer", "ci", Role.VIEWER, 60.0)
    _, seen = visit("/admin/tokens", "admin")
    submit(seen, f"/admin/tokens/{token.id}/revoke")
    assert service.tokens.principal(secret) is None


def test_audit_trail(service, visit):
    """It says whether it is whole, and a search leads to its next page."""
    for i in range(150):
        service.audit.add("eva", "session", "127.0.0.1", "POST /x", "demo & 1", 201, f"number {i}")
    text, _ = visit("/admin/audit?object=demo+%26+1&who=eva", "admin")
    assert '<strong class="good">yes</strong>' in text
    older = re.search(r'href="(/admin/audit\?[^"]+)">Older', text)[1].replace("&amp;", "&")
    assert "number 0<" in visit(older)[0]
    with service.database.write() as connection:
        connection.execute("DELETE FROM audit WHERE number = 7")
    assert "no, entry 7 was changed, or is missing" in visit("/admin/audit")[0]


def test_long_trail_is_checked_when_asked(service, visit, monkeypatch):
    monkeypatch.setattr("clearcap.web.pages.admin.CHECKED_AT_ONCE", 1)
    for _ in range(2):
        service.audit.add("eva", "session", "127.0.0.1", "POST /x", "", 201)
    assert "Check whether" in visit("/admin/audit", "admin")[0]
    assert "The trail is intact" in visit("/admin/audit?check=true")[0]


def test_system(visit, service):
    text, _ = visit("/admin/system", "admin")
    for part in ("job_seconds", service.store.url, "Key of sign-offs"):
        assert part in text


def test_share(client, service, visit, submit, reported, home):
    _, seen = visit(f"{home}/share", "engineer")
    answer = submit(seen, f"{home}/share", note="<i>the customer</i>", days="7")
    assert Page(answer.text).faults == []
    assert "<i>" not in answer.text
    secret = secret_of(answer.text).rpartition("/")[2]
    assert service.tokens.shared(secret).campaign == reported
    _, seen = visit(f"{home}/share")
    assert submit(seen, f"{home}/share/1/revoke").status_code == 303
    assert service.tokens.shared(secret) is None


def test_viewers_do_not_share(client, browse, home):
    browse("viewer")
    assert client.get(f"{home}/share").status_code == 403


def test_sign(client, service, visit, submit, signable, home):
    """An approver signs; a viewer sees it, and later that the report is another one."""
    text, seen = visit(f"{home}/signoff", "viewer")
    assert "Nobody has signed" in text
    assert [form["action"] for form in seen.forms] == ["/logout"]
    _, seen = visit(f"{home}/signoff", "approver")
    assert submit(seen, f"{home}/signoff", comment="as <drawn>").status_code == 303
    text, _ = visit(f"{home}/signoff", "viewer")
    assert "as &lt;drawn&gt;" in text
    assert f"clearcap verify {signable}.zip --key " in text
    service.store.files.write(f"{signable}/report/report.html", b"<p>Cpk 9.99</p>")
    text, _ = visit(f"{home}/signoff?check=true")
    assert "report: report/report.html differs" in text
    _, seen = visit(f"{home}/signoff", "approver")
    assert submit(seen, f"{home}/signoff/withdraw", comment="wrong <drawing>").status_code == 303
    text, _ = visit(f"{home}/signoff", "viewer")
    assert "withdrew the sign-off" in text
    assert "wrong &lt;drawing&gt;" in text


def test_shared_link_shows_the_sign_offs(client, service, visit, reported, home):
    _, secret = service.tokens.share(reported, "engineer", "", 60.0)
    client.get(f"/shared/{secret}")
    text, _ = visit(f"{home}/signoff")
    assert "Nobody has signed" in text


@each(
    "path",
    [
        *("/account/tokens", "/account/tokens/1/revoke", "/account/password", "/account/sessions/end", "/admin/users"),
        *("/admin/users/viewer/role", "/admin/users/viewer/disabled", "/admin/users/viewer/password"),
        *("/admin/users/viewer/link", "/admin/tokens/1/revoke"),
    ],
)
def test_forms_of_another_site(client, service, browse, path):
    """A form without the session's word, or of another origin, does nothing."""
    page = browse("admin")
    fields = {"name": "x", "role": "admin", "password": NEW, "again": NEW, "disabled": "true"}
    assert client.post(path, data=fields, headers={"Origin": URL}).status_code == 403
    assert client.post(path, data=fields, headers=page | {"Origin": "https://evil.example"}).status_code == 403
    assert len(service.users.all()) == len(Role)
    assert service.users.get("viewer").role is Role.VIEWER
