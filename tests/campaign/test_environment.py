"""Processes that compute, or read what was computed, get the variables on which the last digits depend."""

import os
import subprocess

import pytest

import clearcap
from campaign.cluster.local import local_client
from campaign.coordinator.submit import start_coordinator
from campaign.processes import numerical
from campaign.worker.batch import rows_in_subprocess
from campaign.worker.messages import CampaignAddress
from clearcap.web.jobs.process import job_environment
from clearcap.web.web_service import CoordinatorChild
from engine.cad import step_reader
from tests.campaign import fake_engine
from tests.clearcap.web.jobs.strange_jobs import environment

pytestmark = pytest.mark.bits

NUMERICAL = {
    "OPENBLAS_CORETYPE": "Haswell",
    "OMP_PROC_BIND": "true",
    "MKL_CBWR": "COMPATIBLE",
    "NPY_DISABLE_CPU_FEATURES": "FMA3",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "+sse2",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA",
}


class Started(Exception):
    """A process was started; its argument is the environment."""


@pytest.fixture
def _numerical(monkeypatch):
    """Set variables of each kind; no process that is started here computes."""
    for name, value in NUMERICAL.items():
        monkeypatch.setenv(name, value)


def start_isolated_run(store, plan):
    next(rows_in_subprocess(CampaignAddress.of(store, plan, fake_engine.simulate), [3], 1))


def start_script(store, plan):
    clearcap.run_campaign("c60", samples=5, store=store.files.path("."))


def read_step_file(store, plan):
    step_reader.ask_occt("part.step", b"", {}, step_reader.ReadingLimits())


def serve(store, plan):
    CoordinatorChild(store, [])._keep_alive()


@pytest.mark.usefixtures("_numerical")
@pytest.mark.parametrize(
    "start",
    [start_isolated_run, start_script, read_step_file, serve, lambda *given: start_coordinator(*given, [])],
    ids=["isolated run", "script", "CAD", "server", "submit"],
)
def test_a_child_inherits_them(start, store, plan, monkeypatch):
    """Runs in isolation, coordinators of scripts, of a server and of `submit`, and the process that reads STEP."""

    def popen(words, **options):
        raise Started(options["env"])

    monkeypatch.setattr(subprocess, "Popen", popen)
    with pytest.raises(Started) as started:
        start(store, plan)
    assert numerical(started.value.args[0]) == numerical()


@pytest.mark.usefixtures("_numerical")
def test_a_job_of_the_service_gets_them_and_one_thread(monkeypatch):
    """Questions are answered by the kernels that computed the rows; other variables may be secrets."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "8")
    monkeypatch.setenv("CLEARCAP_OIDC_SECRET", "hush")
    given = job_environment()
    assert numerical(given) == numerical()
    assert given["OPENBLAS_NUM_THREADS"] == "1"
    assert "hush" not in given.values()


@pytest.mark.slow
def test_workers_of_this_machine_inherit_them(monkeypatch):
    """They load NumPy, so only what any processor can do is set."""
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Prescott")
    monkeypatch.setenv("MKL_CBWR", "COMPATIBLE")
    with local_client(1) as client:
        assert numerical(client.submit(environment).result()) == numerical(os.environ)
