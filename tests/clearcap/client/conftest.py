"""A server on a port of this machine, and programs that ask it."""

import socket
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest
import uvicorn

from campaign.compiling import compile_engine
from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from clearcap.client.remote_server import connect
from clearcap.web.access import Role
from clearcap.web.server import make_app
from clearcap.web.settings import Settings
from clearcap.web.web_service import open_service
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.clearcap.web.running import PATIENCE
from tests.until import until


@contextmanager
def live(settings):
    """Serve on a free port of loopback in the block; yield the service and the address."""
    compile_engine()
    service = open_service(settings)
    for role in Role:
        if service.users.get(role.word) is None:
            service.users.add(role.word, role)
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen(64)
        config = uvicorn.Config(make_app(service), log_config=None, access_log=False, timeout_graceful_shutdown=2)
        server = uvicorn.Server(config)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
        thread.start()
        until(lambda: server.started, "the server starts")
        try:
            yield service, f"http://127.0.0.1:{listening.getsockname()[1]}"
        finally:
            service.watcher.end_streams()
            server.should_exit = True
            thread.join(PATIENCE)
            assert not thread.is_alive()


@pytest.fixture(scope="module")
def live_server(tmp_path_factory):
    """Return a service with one computing process, and its address; for all tests of a module."""
    folder = tmp_path_factory.mktemp("live")
    with live(Settings(str(folder / "runs"), folder / "data", processes=1)) as pair:
        yield pair


@pytest.fixture
def remote(live_server):
    """Return a client with the token of an engineer."""
    service, address = live_server
    _, secret = service.tokens.add("engineer", "test", Role.ENGINEER, 3600.0)
    with connect(address, secret) as asked:
        yield asked


@pytest.fixture(scope="module")
def finished(live_server, tmp_path_factory):
    """Return the id of a finished campaign of the server, with a report."""
    service, _ = live_server
    file = tmp_path_factory.mktemp("finished") / "demo.toml"
    file.write_text(SPEC)
    store, plan = computed(Path(service.settings.store), load_campaign(str(file)), 10)
    folder = Path(service.settings.store) / plan.campaign_id / "report"
    folder.mkdir()
    (folder / "report.html").write_text("<p>Cpk 1.33</p>")
    (folder / "capability.json").write_text('{"headline": "capable", "responses": []}')
    write_state(store, plan.campaign_id, "completed")
    service.watcher.hurry()
    return plan.campaign_id
