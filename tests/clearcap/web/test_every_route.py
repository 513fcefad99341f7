"""Every route that the routers have: who may not, who may, from where, and what the audit trail says of it."""

import zlib

import pytest
from starlette.testclient import TestClient

from clearcap.web.access import Role
from clearcap.web.http.authentication import COOKIE
from clearcap.web.settings import Settings
from tests.clearcap.web.conftest import URL, copy_store, serving
from tests.clearcap.web.routes import all_ways
from tests.each import each

WAYS = {str(way): way for way in all_ways()}
WRITES = [name for name, way in WAYS.items() if way.is_write]
OPEN_WRITES = {"POST /login", "POST /login/link"}  # the only ways in
OPEN_READS = {
    *("GET /healthz", "GET /readyz"),
    *("GET /", "GET /favicon.ico", "GET /help", "GET /login", "GET /login/link", "GET /shared/{secret}"),
    *("GET /login/company", "GET /login/company/callback"),
}
QUESTIONS = {"whatif", "advice", "advise", "allocate", "allocation", "histogram"}  # sent by POST; they change nothing
ASKING_WRITES = [name for name in WRITES if WAYS[name].needs_login]
LOWER = [(name, role) for name in ASKING_WRITES for role in Role if role < WAYS[name].role]
FOREIGN = {
    "another origin": {"Origin": "https://evil.example"},
    "a page without an origin": {"Origin": "null"},
    "another site": {"Sec-Fetch-Site": "cross-site"},
    "another subdomain": {"Sec-Fetch-Site": "same-site"},
    "without the form's word": {"x-csrf-token": "x" * 43},
}


@pytest.fixture(scope="module")
def everything(finished_store, storage, tmp_path_factory):
    """Return a service, a client, and the id of its campaign, for all tests here: what they ask changes nothing."""
    runs, campaign = finished_store
    folder = tmp_path_factory.mktemp("every-route")
    copy_store(runs, address := storage(folder))
    with serving(Settings(address, folder / "data", processes=0)) as (service, client):
        yield service, client, campaign


@pytest.fixture
def served(everything):
    """Return the service and a client that asks as nobody."""
    everything[1].cookies.clear()
    return everything[:2]


@pytest.fixture
def campaign(everything):
    """Return the id of the campaign that there is."""
    return everything[2]


@pytest.fixture
def ask(service, client, campaign):
    """Return what asks a way with headers, for the campaign, and returns answer and new entries of the audit trail."""

    def asked(way, headers, client=client, **more):
        before = max((entry.number for entry in service.audit.newest(count=1)), default=0)
        answer = client.request(way.method, way.url(campaign=campaign), headers=headers, **more)
        return answer, [entry for entry in service.audit.newest() if entry.number > before]

    return asked


@pytest.fixture
def stranger(client, request):
    """Return what makes a client that asks from an address of its own, as guesses are counted by address."""

    def made(name):
        number = zlib.crc32(f"{request.node.name} {name}".encode())
        address = f"10.{number >> 16 & 255}.{number >> 8 & 255}.{number & 255}"
        return TestClient(client.app, base_url=URL, follow_redirects=False, client=(address, 50000))

    return made


def test_all_but_the_entrance_asks_who_asks():
    """What answers anybody is listed here, by hand."""
    assert {name for name, way in WAYS.items() if not way.needs_login} == OPEN_WRITES | OPEN_READS


def test_pages_that_only_show_are_no_writes():
    """A form that changes something is sent by POST, an API's call also by PUT, PATCH and DELETE."""
    assert {way.method for way in WAYS.values() if not way.path.startswith("/api/")} == {"GET", "POST"}


@each("name", sorted(set(WAYS) - OPEN_READS - OPEN_WRITES))
def test_nobody(name, ask, stranger):
    """Without a login: refused, whatever else is wrong; a write is audited."""
    way = WAYS[name]
    answer, entries = ask(way, {}, stranger(name))
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert [(entry.action, entry.status) for entry in entries] == ([(name, 401)] if way.is_write else [])


@each("name", sorted(set(WAYS) - OPEN_READS - OPEN_WRITES))
def test_wrong_token(name, ask, stranger):
    answer, _ = ask(WAYS[name], {"Authorization": f"Bearer clearcap_token_{'x' * 43}"}, stranger(name))
    assert answer.status_code == 401


@pytest.fixture(scope="module")
def ended(everything):
    """Return the tokens of an admin that have ended, each in its own way."""
    service = everything[0]
    service.users.add("former", Role.ADMIN)
    made = {"expired": ("admin", -1.0), "revoked": ("admin", 3600.0), "of a disabled user": ("former", 3600.0)}
    tokens = {how: service.tokens.add(user, "test", Role.ADMIN, s) for how, (user, s) in made.items()}
    service.tokens.revoke(tokens["revoked"][0].id)
    service.users.change("former", disabled=True)
    return {how: secret for how, (_, secret) in tokens.items()}


@each("name", sorted(set(WAYS) - OPEN_READS - OPEN_WRITES))
def test_token_that_has_ended(name, ask, stranger, ended):
    """Whatever it was for: nobody is known by it."""
    asking = stranger(name)
    for secret in ended.values():
        answer, entries = ask(WAYS[name], {"Authorization": f"Bearer {secret}"}, asking)
        assert answer.status_code == 401
        assert {entry.who for entry in entries} <= {"nobody"}


@each("name, role", LOWER)
def test_lower_role(name, role, ask, as_user):
    """Whoever may less is refused before his input is looked at, and the audit trail knows who it was."""
    answer, entries = ask(WAYS[name], as_user(role.word), content=b"{")
    assert answer.status_code == 403, answer.text
    assert [(entry.who, entry.action, entry.status) for entry in entries] == [(role.word, name, 403)]


@pytest.mark.slow
@each("how", FOREIGN)
@each("name", ASKING_WRITES)
def test_from_another_site(name, how, ask, browse):
    """A page of another site does nothing in the name of whoever is logged in here, and it is written down."""
    answer, entries = ask(WAYS[name], {**browse("admin"), **FOREIGN[how]})
    assert answer.status_code == 403, answer.text
    assert [(entry.action, entry.status) for entry in entries] == [(name, 403)]
    assert entries[0].who == "admin"


@each("name", ASKING_WRITES)
def test_form_without_its_word(name, ask, browse):
    """A form without the field is refused as one with a wrong field is."""
    headers = browse("admin")
    del headers["x-csrf-token"]
    for form in ({"campaign": "1"}, {"csrf": ""}, {"csrf": "x" * 43}):
        answer, entries = ask(WAYS[name], headers, data=form)
        assert answer.status_code == 403, answer.text
        assert [(entry.who, entry.status) for entry in entries] == [("admin", 403)]


def test_a_shared_link_only_asks():
    """Whoever came by a shared link may ask questions and leave; a new write is for users."""
    open_to_shares = {way.path for way in WAYS.values() if way.is_write and way.needs_login and way.is_open_to_shares}
    assert {path for path in open_to_shares if path.rpartition("/")[2] not in QUESTIONS} == {"/logout"}


@each("name", [name for name in ASKING_WRITES if not WAYS[name].is_open_to_shares])
def test_shared_link(name, ask, service, campaign):
    """Whoever came by a shared link changes nothing, here and in other campaigns."""
    _, secret = service.tokens.share(campaign, "engineer", "", 60.0)
    answer, entries = ask(WAYS[name], {"Authorization": f"Bearer {secret}"})
    assert answer.status_code == 403, answer.text
    assert [(entry.action, entry.status) for entry in entries] == [(name, 403)]


@each("name", [name for name, way in WAYS.items() if "{campaign}" in way.path and not way.is_write])
def test_shared_link_shows_no_other_campaign(name, ask, service):
    _, secret = service.tokens.share("another", "engineer", "", 60.0)
    answer, _ = ask(WAYS[name], {"Authorization": f"Bearer {secret}"})
    assert answer.status_code in (403, 404), answer.text


def test_cookie_is_the_browsers_only_login(client, service):
    """The word of a session opens nothing by itself, nor does its cookie under another name."""
    secret = service.sessions.begin("admin")
    for headers in ({"Authorization": f"Bearer {secret}"}, {"Cookie": f"clearcap={secret}"}, {COOKIE: secret}):
        assert client.get("/api/v1/users", headers=headers).status_code == 401
