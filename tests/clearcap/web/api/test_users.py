"""Users, tokens, the own account and the audit trail over the API: who may do what, and what stays of it."""

import pytest
from starlette.testclient import TestClient

from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE, CSRF_HEADER
from tests.clearcap.web.conftest import PASSWORD, URL
from tests.each import each

EVA = {"name": "eva", "role": "engineer"}


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("GET", "/users", None),
        ("POST", "/users", EVA),
        ("PATCH", "/users/viewer", {"role": "admin"}),
        ("POST", "/users/viewer/login-link", None),
        ("GET", "/audit", None),
        ("GET", "/audit/check", None),
        ("GET", "/tokens?everyone=true", None),
    ],
)
def test_only_admins(client, service, as_user, method, path, body):
    """Nobody is 401, every other role 403."""
    assert client.request(method, f"/api/v1{path}", json=body).status_code == 401
    for role in ("viewer", "engineer", "approver"):
        answer = client.request(method, f"/api/v1{path}", json=body, headers=as_user(role))
        assert answer.status_code == 403, role
        assert "admin" in answer.json()["detail"]
    assert len(service.users.all()) == len(Role)
    assert service.users.get("viewer").role is Role.VIEWER


def test_user_from_first_to_last_day(client, service, browse):
    """An admin adds, promotes, gives a password and a link, and disables."""
    admin = browse("admin")
    made = client.post("/api/v1/users", json=EVA | {"password": PASSWORD}, headers=admin)
    assert (made.status_code, made.json()["role"], made.json()["has_password"]) == (201, "engineer", True)
    assert client.post("/api/v1/users", json=EVA, headers=admin).status_code == 409
    changed = client.patch("/api/v1/users/eva", json={"role": "approver"}, headers=admin)
    assert changed.json()["role"] == "approver"
    link = client.post("/api/v1/users/eva/login-link", headers=admin).json()["link"]
    hers = TestClient(client.app, base_url=URL)
    assert hers.get(link.partition(":8700")[2], headers={"Sec-Fetch-Site": "none"}).status_code == 200
    assert service.sessions.principal(hers.cookies[COOKIE]).name == "eva"
    unused = service.sessions.new_link("eva")
    client.patch("/api/v1/users/eva", json={"disabled": True}, headers=admin)
    assert service.sessions.principal(hers.cookies[COOKIE]) is None
    assert client.post("/api/v1/users/eva/login-link", headers=admin).status_code == 409
    client.patch("/api/v1/users/eva", json={"disabled": False}, headers=admin)
    assert hers.get(f"/login/link?key={unused}").status_code == 403
    assert client.patch("/api/v1/users/nobody", json={}, headers=admin).status_code == 404
    entries = client.get("/api/v1/audit", params={"object": "eva"}, headers=admin).json()["entries"]
    assert [entry["detail"] for entry in entries] == ["disabled False", "", "disabled True", "", "role approver"]
    assert PASSWORD not in client.get("/api/v1/audit", headers=admin).text


def test_users_come_in_pages(client, as_user):
    """The cursor of a page leads to the next."""
    admin, names, cursor = as_user("admin"), [], ""
    while cursor is not None:
        page = client.get("/api/v1/users", params={"limit": 2, "cursor": cursor}, headers=admin).json()
        names += [user["name"] for user in page["users"]]
        cursor = page["next"]
    assert names == ["admin", "approver", "engineer", "viewer"]


@each(
    "body",
    [
        {"name": "<script>", "role": "viewer"},
        {"name": "../x", "role": "viewer"},
        {"name": "ada\n", "role": "viewer"},
        {"name": "x", "role": "king"},
        {"name": "x", "role": "viewer", "password": "short"},
        {"name": "x", "role": "viewer", "extra": 1},
        {"name": "x" * 5000, "role": "viewer"},
        {"role": "viewer"},
        [],
    ],
)
def test_hostile_users(client, service, browse, body):
    """They are refused with what is allowed."""
    assert client.post("/api/v1/users", json=body, headers=browse("admin")).status_code == 422
    assert len(service.users.all()) == len(Role)


def test_last_admin_stays(client, browse):
    answer = client.patch("/api/v1/users/admin", json={"role": "viewer"}, headers=browse("admin"))
    assert (answer.status_code, "last admin" in answer.json()["detail"]) == (409, True)


def test_token(client, service, browse):
    """A browser makes one, shown once; it asks with at most its role; then it is revoked."""
    page = browse("engineer")
    new = {"name": "nightly", "role": "engineer", "days": 7}
    made = client.post("/api/v1/tokens", json=new, headers=page)
    assert made.status_code == 201
    secret, listed = made.json()["secret"], made.json()["token"]
    assert secret not in client.get("/api/v1/tokens").text
    assert service.tokens.principal(secret).role is Role.ENGINEER
    by_token = {"Authorization": f"Bearer {secret}"}
    assert client.get("/api/v1/account", headers=by_token).json()["name"] == "engineer"
    assert client.delete(f"/api/v1/tokens/{listed['id']}", headers=page).status_code == 204
    assert client.get("/api/v1/account", headers=by_token).status_code == 401
    assert secret not in str([vars(entry) for entry in service.audit.newest()])


def test_token_is_no_more_than_its_maker(client, browse):
    page = browse("engineer")
    answer = client.post("/api/v1/tokens", json={"name": "x", "role": "approver"}, headers=page)
    assert (answer.status_code, "up to engineer" in answer.json()["detail"]) == (403, True)


def test_token_makes_no_token(client, as_user):
    """It could prolong its own life."""
    answer = client.post("/api/v1/tokens", json={"name": "x", "role": "viewer"}, headers=as_user("admin"))
    assert answer.status_code == 403


def test_too_many_tokens(client, browse, monkeypatch):
    monkeypatch.setattr("clearcap.web.operations.people.MOST_TOKENS", 2)
    page = browse("viewer")
    statuses = [
        client.post("/api/v1/tokens", json={"name": str(i), "role": "viewer"}, headers=page).status_code
        for i in range(3)
    ]
    assert statuses == [201, 201, 409]


def test_tokens_of_others(client, service, as_user, browse):
    """Only an admin sees and ends them."""
    token, _ = service.tokens.add("viewer", "x", Role.VIEWER, 60.0)
    assert client.delete(f"/api/v1/tokens/{token.id}", headers=browse("engineer")).status_code == 404
    client.cookies.clear()
    admin = as_user("admin")
    listed = client.get("/api/v1/tokens?everyone=true&limit=1", headers=admin).json()
    assert (listed["tokens"][0]["user"], listed["next"]) == ("admin", token.id + 1)
    following = client.get(f"/api/v1/tokens?everyone=true&cursor={listed['next']}", headers=admin).json()
    assert (following["tokens"][0]["user"], following["next"]) == ("viewer", None)
    assert client.delete(f"/api/v1/tokens/{token.id}", headers=admin).status_code == 204
    assert service.tokens.all("viewer")[0].revoked is not None


def test_own_password(client, service, browse, as_user):
    """The present one is asked for, and guessing it is slowed down; then all sessions end."""
    service.users.change("viewer", password=PASSWORD)
    page = browse("viewer")
    change = {"present": "wrong password", "password": "another long password"}
    wrong = [client.put("/api/v1/account/password", json=change, headers=page).status_code for _ in range(6)]
    assert wrong == [403] * 5 + [429]
    service.logins.succeeded("viewer", "testclient")
    answer = client.put("/api/v1/account/password", json=change | {"present": PASSWORD}, headers=page)
    assert answer.status_code == 204
    assert service.users.by_password("viewer", change["password"]) is not None
    assert client.get("/api/v1/account").status_code == 401
    client.cookies.clear()
    assert client.put("/api/v1/account/password", json=change, headers=as_user("viewer")).status_code == 403


def test_own_sessions_end(client, service, browse):
    other = service.sessions.begin("viewer")
    page = browse("viewer")
    assert service.sessions.count("viewer") == 2
    assert client.delete("/api/v1/account/sessions", headers=page).status_code == 204
    assert service.sessions.principal(other) is None
    assert client.get("/api/v1/account").status_code == 401


@pytest.mark.parametrize(
    ("method", "path"),
    [("POST", "/users"), ("POST", "/tokens"), ("PUT", "/account/password"), ("DELETE", "/account/sessions")],
)
def test_write_from_another_site(client, service, browse, method, path):
    """It is refused and audited: another origin, none of the session's word, or the word of another session."""
    page = browse("admin")
    other = service.sessions.principal(service.sessions.begin("admin")).csrf
    for headers in ({"Origin": "https://evil.example"}, {"Sec-Fetch-Site": "cross-site"}, {"Origin": "http://["},
                    {CSRF_HEADER: ""}, {CSRF_HEADER: other}):  # fmt: skip
        answer = client.request(method, f"/api/v1{path}", json=EVA, headers=page | headers)
        assert answer.status_code == 403, headers
        newest = service.audit.newest(count=1)[0]
        assert (newest.who, newest.status) == ("admin", 403)
    assert service.users.get("eva") is None


def test_shared_link_is_no_account(client, service):
    """Whoever has one can neither make tokens nor see who he is."""
    _, secret = service.tokens.share("demo-1", "viewer", "", 60.0)
    shared = {"Authorization": f"Bearer {secret}"}
    for method, path in (("GET", "/account"), ("GET", "/tokens"), ("POST", "/tokens"), ("DELETE", "/account/sessions")):
        answer = client.request(method, f"/api/v1{path}", json={"name": "x", "role": "viewer"}, headers=shared)
        assert answer.status_code == 403, path


def test_audit_trail_comes_in_pages(client, service, as_user):
    """Newest first; of one user, of one object; and a change of it is found."""
    for i in range(5):
        service.audit.add("eva", "session", "127.0.0.1", "POST", f"demo-{i % 2} {i}", 201)
    admin = as_user("admin")
    first = client.get("/api/v1/audit", params={"object": "demo-0", "limit": 2}, headers=admin).json()
    assert [entry["object"] for entry in first["entries"]] == ["demo-0 4", "demo-0 2"]
    rest = client.get("/api/v1/audit", params={"object": "demo-0", "cursor": first["next"]}, headers=admin).json()
    assert ([entry["object"] for entry in rest["entries"]], rest["next"]) == (["demo-0 0"], None)
    assert client.get("/api/v1/audit", params={"who": "bob"}, headers=admin).json()["entries"] == []
    assert client.get("/api/v1/audit/check", headers=admin).json() == {"whole": True, "first_fault": None}
    with service.database.write() as connection:
        connection.execute("UPDATE audit SET who = 'bob' WHERE number = 3")
    assert client.get("/api/v1/audit/check", headers=admin).json() == {"whole": False, "first_fault": 3}
