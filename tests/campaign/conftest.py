"""A small campaign on the C-60's description, for tests that need no physics."""

import os
import pickle
from contextlib import contextmanager
from functools import partial
from multiprocessing import forkserver, get_context

import dask
import pytest
from typer.testing import CliRunner

from campaign.cluster import workers as of_dask
from campaign.coordinator import coordinate as coordinating
from campaign.coordinator import rerun as rerunning
from campaign.coordinator import submit as submission
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from tests.campaign import fake_engine, process_workers
from tests.fitted_once import fitted_once as fitted_once  # a fixture of all tests below

SPEC = """\
format = 1
name = "demo"
mechanism = "c60"
samples = 25
seed = 7

[variables.J1]
distribution = "truncated_normal"
mean = 0.07
std = 0.0175
lower = 0.01
upper = 0.13

[variables.preload]
target = "springs.A3.preload"
distribution = "uniform"
lower = 0.9
upper = 1.0

[responses.FC-1]
lsl = 9.0
usl = 16.0
source = "a test"
"""


@pytest.fixture
def campaign_file(tmp_path):
    """Return the path of a sound campaign file; change its text to make it unsound."""
    path = tmp_path / "demo.toml"
    path.write_text(SPEC)
    return path


@pytest.fixture(scope="session")
def pickled_campaign(tmp_path_factory):
    """Return the campaign of the sound file as bytes: to load it once more takes far longer than to copy it."""
    path = tmp_path_factory.mktemp("demo") / "demo.toml"
    path.write_text(SPEC)
    return pickle.dumps(load_campaign(str(path)))


@pytest.fixture
def campaign(pickled_campaign):
    """Return the campaign of the sound file; each test has one of its own."""
    return pickle.loads(pickled_campaign)


@pytest.fixture
def plan(campaign):
    """Return its plan in batches of 10, 10 and 5."""
    return make_plan(campaign, 10)


@pytest.fixture
def store(tmp_path, plan):
    """Return a store in a folder, holding the plan."""
    opened = open_store(str(tmp_path / "runs"))
    opened.create_plan(plan)
    return opened


@pytest.fixture(scope="session")
def s3_port():
    """Return the port of a server that speaks S3; each test has a bucket of its own."""
    from tests.campaign.store.files.test_s3 import s3_server  # which imports this module

    with s3_server() as (_, port):
        yield port


@pytest.fixture(params=["folder", pytest.param("s3", marks=pytest.mark.processes)])
def either_store(request, tmp_path, monkeypatch, plan):
    """Return a store that holds the plan: in a folder, and on S3."""
    from tests.campaign.store.files.test_s3 import bucket

    in_folder = request.param == "folder"
    url = str(tmp_path / "runs") if in_folder else bucket(monkeypatch, request.getfixturevalue("s3_port"))
    opened = open_store(url)
    opened.create_plan(plan)
    return opened


@pytest.fixture(scope="session")
def server_of_processes():
    """Start a process of which workers are forks: it has imported what each of them would import for two seconds."""
    needed = ["distributed.nanny", "campaign.worker.batch", "engine.loop", "pandas", "tests.campaign.fake_engine"]
    get_context("forkserver").set_forkserver_preload(needed)
    with pytest.MonkeyPatch.context() as patch:
        for name in ("PYTHONSAFEPATH", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
            patch.setenv(name, "1")
        forkserver.ensure_running()


@pytest.fixture(scope="module")
def forked_workers(server_of_processes):
    """Have the workers of a module's campaigns forked; clusters and storms prove how they start elsewhere."""
    with (
        dask.config.set({"distributed.worker.multiprocessing-method": "forkserver"}),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(process_workers, "get_context", lambda _: get_context("forkserver"))
        yield


@pytest.fixture(scope="module")
def kept_workers(tmp_path_factory, forked_workers):
    """Return two processes that compute for all tests of a module; they start in a folder of their own."""
    with process_workers.process_workers(2) as workers:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(tmp_path_factory.mktemp("workers"))
            for _ in range(2):
                workers.submit("start", os.getpid)
            while workers.next_finished():
                pass
        yield workers


@pytest.fixture
def workers(kept_workers, monkeypatch):
    """Have campaigns computed by the module's processes, whatever cluster they name: starting workers takes seconds."""

    @contextmanager
    def connect_workers(_):
        yield kept_workers

    for module in (coordinating, of_dask, rerunning):
        monkeypatch.setattr(module, "connect_workers", connect_workers)


@pytest.fixture
def faked(workers, monkeypatch, tmp_path):
    """Put the stand-in in the engine's place, stand in an empty folder, and return what runs the command."""
    monkeypatch.chdir(tmp_path)
    for module, verb in ((coordinating, "coordinate"), (submission, "submit")):
        monkeypatch.setattr(module, verb, partial(getattr(module, verb), simulate=fake_engine.simulate))
    return CliRunner()
