"""Who may do what: every route, six identities, with a token and in a browser, to one's own campaign and to another's.

The rules are written here by hand, by path; the roles of routes are those of `test_every_route`.
"""

import itertools
from contextlib import contextmanager
from dataclasses import replace

import pytest

from campaign.coordinator.state import state_of, write_state
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store.labels import LabelChange, change_labels, read_labels
from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE
from clearcap.web.jobs.process import JobPostponed
from clearcap.web.settings import Limits, Settings
from tests.campaign.conftest import SPEC
from tests.clearcap.web.conftest import PASSWORD, URL, copy_store, serving
from tests.clearcap.web.test_every_route import OPEN_READS, OPEN_WRITES, WAYS
from tests.each import each

IDENTITIES = ("nobody", "link", "viewer", "engineer", "approver", "admin")
# ends of the paths that only owner and admin may ask: what they do is kept with the campaign
CHANGES = ("/monitor", "/confirmation", "/confirm", "/cancel", "/resume", "/rerun", "/delete")
OF_OWNER = {name for name, way in WAYS.items() if way.is_write and "{campaign}" in name and name.endswith(CHANGES)}
OF_OWNER |= {"DELETE /api/v1/campaigns/{campaign}"}
GIVES_ACCESS = {  # what no token does
    *("POST /api/v1/users", "PATCH /api/v1/users/{name}", "POST /api/v1/users/{name}/login-link"),
    *("POST /api/v1/tokens", "PUT /api/v1/account/password"),
    *("POST /admin/users", "POST /admin/users/{name}/role", "POST /admin/users/{name}/password"),
    *("POST /admin/users/{name}/link", "POST /account/tokens", "POST /account/password"),
}
BODIES = {
    "POST /api/v1/users": {"json": {"name": "eve", "role": "admin"}},
    "PATCH /api/v1/users/{name}": {"json": {"role": "admin"}},
    "POST /api/v1/tokens": {"json": {"name": "x", "role": "viewer"}},
    "PUT /api/v1/account/password": {"json": {"password": PASSWORD}},
    "POST /admin/users": {"data": {"name": "eve", "role": "admin"}},
    "POST /admin/users/{name}/role": {"data": {"role": "admin"}},
    "POST /admin/users/{name}/password": {"data": {"password": PASSWORD}},
    "POST /account/tokens": {"data": {"name": "x", "role": "viewer"}},
    "POST /account/password": {"data": {"password": PASSWORD, "again": PASSWORD}},
}


@pytest.fixture(scope="module")
def world(finished_store, storage, tmp_path_factory):
    """Return a service, a client, and the id of a campaign; each test says whose it is."""
    runs, campaign = finished_store
    folder = tmp_path_factory.mktemp("authority")
    copy_store(runs, address := storage(folder))
    settings = Settings(address, folder / "data", processes=0, limits=Limits(failures=10**6))
    with serving(settings) as (service, client):
        service.pool.run = service.pool.data = _no_job
        yield service, client, campaign


async def _no_job(*_, **__):
    raise JobPostponed("nothing is computed here")


@pytest.fixture
def served(world):
    """Return the service and a client that asks as nobody."""
    world[1].cookies.clear()
    return world[:2]


@pytest.fixture
def campaign(world):
    """Return the id of the campaign."""
    return world[2]


def owned_by(service, campaign, owner):
    """Give a campaign to a user, as a store's own administrator does."""
    change_labels(service.store, campaign, LabelChange(owner=owner), by="test")


def headers_of(service, identity, campaign):
    """Return the headers of a program that asks as one of the identities."""
    if identity == "nobody":
        return {}
    if identity == "link":
        return {"Authorization": f"Bearer {service.tokens.share(campaign, 'admin', '', 60.0)[1]}"}
    return {"Authorization": f"Bearer {service.tokens.add(identity, 'test', Role.of(identity), 60.0)[1]}"}


def expected(name, identity, owner):
    """Return the status with which an identity is refused before anything is looked at; None if it is not."""
    if name in OPEN_READS | OPEN_WRITES:
        return None
    if identity == "nobody":
        return 401
    way = WAYS[name]
    if identity == "link":
        return None if way.is_open_to_shares else 403
    if Role.of(identity) < way.role or (name in OF_OWNER and owner != identity and identity != "admin"):
        return 403
    return 403 if name in GIVES_ACCESS else None  # all ask with a token here


@pytest.mark.slow
@each("name", [name for name, way in WAYS.items() if way.is_write])
def test_table_of_writes(name, world, served):
    """Whoever may not is refused with what the table says; whoever may gets no such answer, whatever else is wrong."""
    service, client, campaign = world
    way = WAYS[name]
    body = BODIES.get(name, {"content": b""})
    for identity, owner in itertools.product(IDENTITIES, ("engineer", "somebody")):
        with unchanged(service, campaign, owner):
            headers = headers_of(service, identity, campaign)
            answer = client.request(way.method, way.url(campaign=campaign), headers=headers, **body)
        wanted = expected(name, identity, owner)
        got = answer.status_code if answer.status_code in (401, 403) else None
        if name not in OPEN_WRITES:  # where a login itself may be refused
            assert got == wanted, (identity, owner, answer.status_code, answer.text[:300])


@contextmanager
def unchanged(service, campaign, owner):
    """Have a campaign owned by a user in the block; afterwards it and the users are as they were."""
    owned_by(service, campaign, owner)
    write_state(service.store, campaign, "completed")
    yield
    assert service.store.files.exists(f"{campaign}/plan.json")
    assert service.users.get("eve") is None
    assert [user.role.word for user in service.users.all()] == [user.name for user in service.users.all()]


@each("name", [name for name, way in WAYS.items() if not way.is_write and name not in OPEN_READS])
def test_table_of_reads(name, world, served):
    service, client, campaign = world
    way = WAYS[name]
    for identity in IDENTITIES[:1] if way.path.endswith("/events") else IDENTITIES:  # that answer has no end
        answer = client.get(way.url(campaign=campaign), headers=headers_of(service, identity, campaign))
        got = answer.status_code if answer.status_code in (401, 403) else None
        assert got == expected(name, identity, ""), (identity, answer.status_code, answer.text[:300])


@each("name", sorted(GIVES_ACCESS))
def test_a_browser_gives_access(name, served, browse):
    """What a token may not, the same user may who is logged in."""
    service, client = served
    client.cookies.clear()
    service.users.add("eve-once", Role.VIEWER)
    answer = client.request(
        WAYS[name].method, WAYS[name].url(name="eve-once"), headers=browse("admin"), **BODIES.get(name, {})
    )
    assert answer.status_code < 400, answer.text
    with service.database.write() as connection:
        for table in ("sessions", "login_links", "tokens"):
            connection.execute(f"DELETE FROM {table}")
        connection.execute("DELETE FROM users WHERE name NOT IN ('viewer', 'engineer', 'approver', 'admin')")
        connection.execute("UPDATE users SET password = NULL")


def test_a_token_disables(served, as_user):
    """It may end access, as a program of the personnel department does, but not give it."""
    service, client = served
    service.users.add("leaver", Role.VIEWER)
    for change, status in (
        ({"disabled": True}, 200),
        ({"disabled": False}, 403),
        ({"disabled": True, "role": "admin"}, 403),
    ):
        assert client.patch("/api/v1/users/leaver", json=change, headers=as_user("admin")).status_code == status
    with service.database.write() as connection:
        connection.execute("DELETE FROM users WHERE name = 'leaver'")


def test_only_owner_and_admin_give_a_campaign_away(served, campaign, as_user):
    """To users that exist and are not disabled; an engineer cannot take it."""
    service, client = served
    where = f"/api/v1/campaigns/{campaign}/labels"
    owned_by(service, campaign, "approver")

    def given(by, to):
        return client.patch(where, json={"owner": to}, headers=as_user(by)).status_code

    assert [given("engineer", "engineer"), given("engineer", ""), given("engineer", "approver")] == [403, 403, 200]
    assert [given("approver", "nobody"), given("approver", "engineer"), given("approver", "approver")] == [
        422,
        200,
        403,
    ]
    assert [given("admin", "approver"), read_labels(service.store, campaign).owner] == [200, "approver"]
    for change, status in (
        ({"archived": True}, 403),
        ({"note": "seen", "add_tags": ["night"], "archived": False}, 200),
    ):
        assert client.patch(where, json=change, headers=as_user("engineer")).status_code == status


def test_owner_is_who_submitted_it(served, campaign, as_user):
    """Where no label says another."""
    service, client = served
    owned_by(service, campaign, "")
    service.store.write_json(campaign, "submission.json", {"user": "engineer", "time": 0.0})
    assert client.post(f"/api/v1/campaigns/{campaign}/cancel", headers=as_user("engineer")).status_code == 200
    assert client.post(f"/api/v1/campaigns/{campaign}/cancel", headers=as_user("approver")).status_code == 403


def test_every_way_into_the_queue_is_counted(storage, tmp_path, campaign, served):
    """Whoever cancels one of his campaigns to submit another cannot continue the first, nor compute its rows again."""
    settings = Settings(storage(tmp_path), tmp_path / "data", processes=0, limits=Limits(running=2))
    with serving(settings) as (service, client):
        ids = []
        for number in range(3):
            (tmp_path / f"{number}.toml").write_text(SPEC.replace('"demo"', f'"demo{number}"'))
            plan = submit(service.store, load_campaign(str(tmp_path / f"{number}.toml")), 10, by="engineer")
            ids.append(plan.campaign_id)
        write_state(service.store, ids[0], "cancelled")
        headers = headers_of(service, "engineer", ids[0])
        for call in ("resume", "rerun"):
            answer = client.post(f"/api/v1/campaigns/{ids[0]}/{call}", json={}, headers=headers)
            assert (answer.status_code, state_of(service.store, ids[0])["state"]) == (429, "cancelled"), answer.text
        write_state(service.store, ids[1], "interrupted")
        for _ in range(2):  # one that counts already needs no further place
            assert client.post(f"/api/v1/campaigns/{ids[1]}/resume", headers=headers).status_code == 200
        write_state(service.store, ids[2], "cancelled")
        assert client.post(f"/api/v1/campaigns/{ids[0]}/resume", headers=headers).status_code == 200
        assert client.post(f"/api/v1/campaigns/{ids[2]}/resume", headers=headers).status_code == 429


def test_access_ends_with_one_call(served, campaign, as_user):
    """Sessions, links, tokens, shared links with their sessions, webhooks: by the call, a reset, and disabling."""
    service, client = served
    admin = as_user("admin")

    def made():
        """Return the secrets of a user's access, of all kinds."""
        share, secret = service.tokens.share(campaign, "victim", "", 60.0)
        service.webhooks.add("victim", None, "https://example.com/x", ())
        return {
            "session": service.sessions.begin("victim"),
            "link": service.sessions.new_link("victim"),
            "token": service.tokens.add("victim", "x", Role.VIEWER, 60.0)[1],
            "share": secret,
            "shared session": service.sessions.begin(share=share.id),
        }

    def alive(secrets):
        """Return which of them still open something."""
        found = {kind for kind, secret in secrets.items() if service.sessions.principal(secret)}
        found |= {kind for kind, secret in secrets.items() if service.tokens.principal(secret)}
        found |= {"link"} if service.sessions.user_of_link(secrets["link"]) else set()
        return found | ({"webhook"} if service.webhooks.all("victim") else set())

    service.users.add("victim", Role.ENGINEER, PASSWORD)
    everything = {"session", "link", "token", "share", "shared session", "webhook"}
    for end in (
        lambda: client.delete("/api/v1/users/victim/access", headers=admin).status_code == 204,
        lambda: service.users.change("victim", password=f"{PASSWORD} again"),
        lambda: service.users.change("victim", disabled=True) and service.users.change("victim", disabled=False),
    ):
        secrets = made()
        assert alive(secrets) == everything
        assert end()
        assert alive(secrets) == set()
    secrets = made()
    service.users.change("victim", password=PASSWORD, is_own=True)
    assert alive(secrets) == everything - {"session", "link"}
    service.users.end_access("victim")
    with service.database.write() as connection:
        connection.execute("DELETE FROM tokens WHERE user = 'victim'")
        connection.execute("DELETE FROM users WHERE name = 'victim'")


def test_four_eyes(settings, reported, monkeypatch):
    """Where the server is told so, nobody signs what he, or nobody known, has submitted; others reach the signing."""
    with serving(replace(settings, four_eyes=True)) as (service, client):
        monkeypatch.setattr(service.pool, "data", _no_job)
        where = f"/api/v1/campaigns/{reported}/signoffs"

        def signed(submitter):
            service.store.write_json(reported, "submission.json", {"user": submitter, "time": 0.0})
            headers = headers_of(service, "approver", reported)
            return client.post(where, json={"content": "0" * 64}, headers=headers).status_code

        assert [signed("approver"), signed(""), signed("engineer")] == [403, 403, 503]


def test_one_fool_locks_out_nobody(served, monkeypatch):
    """Ten guesses end those at one name from one address; the office goes on, and so does who is known there."""
    service, client = served
    logins = type(service.logins)(10, 300.0)
    monkeypatch.setattr(service, "logins", logins)
    for name in ("viewer", "engineer", "approver"):
        service.users.change(name, password=PASSWORD)

    def statuses(name, password, times=1):
        return [client.post("/login", data={"name": name, "password": password}).status_code for _ in range(times)]

    assert statuses("viewer", PASSWORD) == [200]
    assert statuses("engineer", "wrong password", 11) == [401] * 10 + [429]
    assert statuses("engineer", PASSWORD) == [429]
    assert statuses("viewer", PASSWORD) == [200]
    for number in range(90):
        assert statuses(f"guess{number}", "wrong password") == [401]
    assert statuses("approver", PASSWORD) == [429]  # not seen here before: an address has a limit too
    assert statuses("viewer", PASSWORD) == [200]
    monkeypatch.setattr(service, "logins", type(service.logins)(10, 300.0))
    for number in range(100):
        assert not service.logins.attempt("viewer", f"10.0.0.{number}")
    assert service.logins.attempt("viewer", "10.0.1.1")
    assert service.users.change("viewer", password=PASSWORD)


def test_a_login_link_asks(served):
    """From another site, and where somebody else is logged in; only the answer to the question uses it up."""
    service, client = served
    service.users.add("eva", Role.VIEWER)
    key = service.sessions.new_link("eva")
    where = f"/login/link?key={key}&next=/mechanisms"
    for site in ("cross-site", "same-site", None):
        answer = client.get(where, headers={} if site is None else {"Sec-Fetch-Site": site})
        assert ("Log in as eva?" in answer.text, "set-cookie" in answer.headers) == (True, False)
    client.cookies.set(COOKIE, service.sessions.begin("admin"))
    asked = client.get(where, headers={"Sec-Fetch-Site": "none"})
    assert "You are logged in as <strong>admin</strong>" in asked.text
    form = {"key": key, "next": "/mechanisms"}
    assert client.post("/login/link", data=form, headers={"Sec-Fetch-Site": "cross-site"}).status_code == 403
    answer = client.post("/login/link", data=form, headers={"Origin": URL})
    assert 'content="0; url=/mechanisms"' in answer.text
    assert service.sessions.principal(answer.cookies[COOKIE]).name == "eva"
    assert (service.audit.newest()[0].who, service.audit.newest()[0].how) == ("eva", "link")
    assert client.post("/login/link", data=form, headers={"Origin": URL}).status_code == 403
    client.cookies.clear()
    again = service.sessions.new_link("eva")
    typed = client.get(f"/login/link?key={again}", headers={"Sec-Fetch-Site": "none"})  # nobody is replaced
    assert service.sessions.principal(typed.cookies[COOKIE]).name == "eva"
