"""A service over a store with one finished campaign, and browsers and programs that ask it."""

import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from campaign.web.access import Role
from campaign.web.app import make_app
from campaign.web.http.asking import COOKIE, CSRF_HEADER
from campaign.web.settings import Limits, Settings
from campaign.web.web_service import open_service
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed

URL = "https://localhost"  # so that the client sends a secure cookie back
PASSWORD = "correct horse battery"


@contextmanager
def serving(settings):
    """Serve in the block, with users of all roles; yield the service and a client that asks as nobody."""
    service = open_service(settings)
    for role in Role:
        if service.users.get(role.word) is None:
            service.users.add(role.word, role)
    with TestClient(make_app(service), base_url=URL, follow_redirects=False) as client:
        yield service, client


@pytest.fixture(scope="session")
def finished_store(tmp_path_factory):
    """Return the folder of a store with a finished campaign of 25 samples, and its id; only to be read."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "demo.toml").write_text(SPEC)
    store, plan = computed(folder / "runs", load_campaign(str(folder / "demo.toml")), 10)
    write_state(store, plan.campaign_id, "completed")
    return folder / "runs", plan.campaign_id


@pytest.fixture
def settings(tmp_path):
    """Return settings of a server on loopback with a store of its own."""
    return Settings(str(tmp_path / "runs"), tmp_path / "data", processes=0, limits=Limits(failures=5))


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
    runs, campaign = finished_store
    shutil.copytree(runs, settings.store)
    folder = Path(settings.store) / campaign / "report"
    folder.mkdir()
    (folder / "report.html").write_text("<p>Cpk 1.33</p>")
    (folder / "capability.json").write_text('{"headline": "capable", "responses": []}')
    return campaign
