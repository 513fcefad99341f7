"""A service over a store with one finished campaign, and browsers and programs that ask it.

The store is in a folder. With ``CLEARCAP_STORE_OF_TESTS=s3``, as `make full` has it, it is on S3 in all tests
but those that are only for a folder.
"""

import os
import shutil
from contextlib import contextmanager
from itertools import count

import pytest
from starlette.concurrency import run_in_threadpool
from starlette.testclient import TestClient

from campaign.compiling import compile_engine
from campaign.coordinator.state import write_state
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.store import change_tokens
from clearcap.questions.report import report
from clearcap.web.access import Role, users
from clearcap.web.http.authentication import COOKIE, CSRF_HEADER
from clearcap.web.server import make_app
from clearcap.web.settings import Limits, Settings
from clearcap.web.web_service import open_service
from engine import simulate
from tests.campaign import fake_engine
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed

URL = "https://localhost"  # so that the client sends a secure cookie back
PASSWORD = "correct horse battery"
_routes = []  # of the first application


def only_in_a_folder(test):
    """Never run a test with a store on S3: it does to the store's files what only a file system allows."""
    test.is_only_in_a_folder = True
    return test


def pytest_generate_tests(metafunc):
    """Choose where the store of a test is."""
    if "storage" in metafunc.fixturenames:
        is_anywhere = not getattr(metafunc.function, "is_only_in_a_folder", False)
        is_on_s3 = os.environ.get("CLEARCAP_STORE_OF_TESTS") == "s3" and is_anywhere
        place = "s3" if is_on_s3 else pytest.param("folder", id=pytest.HIDDEN_PARAM)
        metafunc.parametrize("storage", [place], indirect=True, scope="session")


@pytest.fixture(scope="session", autouse=True)
def cheap_passwords():
    """Have passwords hashed with little work; return how much it is otherwise, and for passwords that others check."""
    usual = users._COST
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(users, "_COST", 2)
        yield usual


@pytest.fixture(scope="session")
def campaign(tmp_path_factory):
    """Return the campaign of the file, which takes a while to load; nothing can change it."""
    file = tmp_path_factory.mktemp("campaign") / "demo.toml"
    file.write_text(SPEC)
    return load_campaign(str(file))


@pytest.fixture(scope="session")
def plan(campaign):
    """Return its plan in batches of 10, 10 and 5."""
    return make_plan(campaign, 10)


@pytest.fixture(scope="session")
def storage(request):
    """Return what makes the address of a new store: in a folder that it is given, or on S3."""
    if getattr(request, "param", "folder") == "folder":
        yield lambda folder: str(folder / "runs")
        return
    from tests.campaign.store.files.test_s3 import bucket, s3_server

    with s3_server() as (_, port), pytest.MonkeyPatch.context() as patch:
        address, numbers = bucket(patch, port), count()  # from here on all processes that start know the server
        yield lambda _: f"{address}-{next(numbers)}"


def copy_store(address, new):
    """Copy all files of a store into a new one."""
    if "://" not in address:
        shutil.copytree(address, new)
        return
    source, target = open_store(address).files, open_store(new).files
    for name in source.stamps(""):
        target.write(name, source.read(name))


def app_of(service):
    """Return the application of a service, with the routes of the first one.

    FastAPI looks at the parameters of all routes when an application is asked for the first time: 0.2 s.
    """
    app = make_app(service)
    if not _routes:
        _routes.extend(app.router.routes)
    app.router.routes[:] = _routes
    return app


@contextmanager
def serving(settings):
    """Serve in the block, with users of all roles; yield the service and a client that asks as nobody."""
    if settings.processes:
        compile_engine()
    service = open_service(settings)
    for role in Role:
        if service.users.get(role.word) is None:
            service.users.add(role.word, role)
    with TestClient(app_of(service), base_url=URL, follow_redirects=False) as client:
        yield service, client


@pytest.fixture(scope="session")
def finished_store(storage, tmp_path_factory):
    """Return the address of a store with a finished campaign of 25 samples, and its id; only to be read."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "demo.toml").write_text(SPEC)
    address = storage(folder)
    store, plan = computed(address, load_campaign(str(folder / "demo.toml")), 10)
    write_state(store, plan.campaign_id, "completed")
    return address, plan.campaign_id


@pytest.fixture(scope="session")
def computing_service(finished_store, storage, tmp_path_factory):
    """Return a service with a computing process, and a client that asks as nobody; for all tests that need one.

    Its store has a finished campaign of 25 samples, another one of 400 with a wider J1, and one of 4 that the engine
    has computed.
    """
    folder = tmp_path_factory.mktemp("computing")
    address = storage(folder)
    copy_store(finished_store[0], address)
    for name, text, samples, run in (
        ("wider", SPEC.replace("std = 0.0175", "std = 0.02"), 400, fake_engine.simulate),
        ("real", SPEC.replace('"demo"', '"real"').replace("seed = 7", "seed = 8"), 4, simulate),
    ):
        (folder / f"{name}.toml").write_text(text)
        store, plan = computed(address, load_campaign(str(folder / f"{name}.toml"), samples=samples), 10, run)
        write_state(store, plan.campaign_id, "completed")
    with serving(Settings(address, folder / "data", processes=1)) as pair:
        yield pair


@pytest.fixture
def computing(computing_service):
    """Return a client of a service with a computing process, and what makes a program's headers by role."""
    service, client = computing_service
    client.cookies.clear()

    def headers(role):
        return {"Authorization": f"Bearer {service.tokens.add(role, 'test', Role.of(role), 3600.0)[1]}"}

    return client, headers


@pytest.fixture(scope="session")
def explored(finished_store, computing_service):
    """Return the ids of the campaigns of `computing_service`: the finished, the wider, and the one with real runs."""
    service, _ = computing_service
    _, finished = finished_store
    plans = [service.store.plan(each) for each in service.store.campaigns()]
    real = next(plan.campaign_id for plan in plans if plan.spec.name == "real")
    return finished, next(p.campaign_id for p in plans if p.campaign_id not in (finished, real)), real


@pytest.fixture
def store(storage, tmp_path, plan):
    """Return a store that holds the plan of a campaign."""
    opened = open_store(storage(tmp_path))
    opened.create_plan(plan)
    return opened


@pytest.fixture
def settings(storage, tmp_path):
    """Return settings of a server on loopback with a store of its own."""
    return Settings(storage(tmp_path), tmp_path / "data", processes=0, limits=Limits(failures=5))


@pytest.fixture
def served(settings):
    """Return a service and a client that asks as nobody."""
    with serving(settings) as pair:
        yield pair


@pytest.fixture
def service(served):
    """Return the service."""
    return served[0]


@pytest.fixture
def client(served):
    """Return a client that asks as nobody."""
    return served[1]


@pytest.fixture
def as_user(served):
    """Return what makes headers by which a program asks with a token of a role."""
    service, _ = served

    def headers(role):
        _, secret = service.tokens.add(role, "test", Role.of(role), 3600.0)
        return {"Authorization": f"Bearer {secret}"}

    return headers


@pytest.fixture
def browse(served):
    """Return what makes cookie and headers of a browser's own page, for a user of a role."""
    service, client = served

    def headers(role):
        secret = service.sessions.begin(role)
        client.cookies.set(COOKIE, secret)
        csrf = service.sessions.principal(secret).csrf
        return {CSRF_HEADER: csrf, "Origin": URL, "Sec-Fetch-Site": "same-origin"}

    return headers


@pytest.fixture
def reported(finished_store, settings):
    """Return the id of a completed campaign with a report, in a store of its own, to be served by `settings`."""
    address, campaign = finished_store
    copy_store(address, settings.store)
    files = open_store(settings.store).files
    files.write(f"{campaign}/report/report.html", b"<p>Cpk 1.33</p>")
    files.write(f"{campaign}/report/capability.json", b'{"headline": "capable", "responses": []}')
    return campaign


def read_all(index, store):
    """Have an index read all campaigns of a store that have changed."""
    index.look(change_tokens(store))
    while index.is_behind:
        index.read_some(store)


def write_real_report(service, campaign):
    """Write the report of a campaign from its rows, as only that can be signed."""
    report(service.store, service.store.plan(campaign))


@pytest.fixture
def signable(reported, service, monkeypatch):
    """Return the id of a completed campaign with the report of its rows; its service computes in this process."""

    async def data(_, job, *arguments):
        return await run_in_threadpool(job, *arguments)

    files = service.store.files
    for name in files.names(f"{reported}/report"):
        files.remove(f"{reported}/report/{name}")
    write_real_report(service, reported)
    monkeypatch.setattr(service.pool, "data", data)
    return reported
