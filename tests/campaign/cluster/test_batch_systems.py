"""Workers as jobs: what dask's configuration must say, and what is asked of the batch system."""

import shlex
import subprocess
import sys
from pathlib import Path

import dask
import pytest
import yaml

import campaign.cluster.connect
from campaign.cluster.batch_systems import _package, job_certificates, job_cluster, kubernetes_resource, submission
from campaign.cluster.cluster import Cluster, Tls
from campaign.cluster.connect import connect
from campaign.cluster.tls_certificates import make_certificates
from campaign.errors import SpecError, UnreachableError
from tests.campaign.kubernetes_api import kubernetes_api

_package("dask_jobqueue", "jobqueue", "slurm")  # sets defaults in dask's configuration that must outlive a test
DEPLOY = Path(__file__).parents[3] / "deploy"
COMMANDS = {"slurm": "sbatch", "oar": "oarsub", "pbs": "qsub"}


@pytest.fixture
def tls(tmp_path):
    """Return certificates."""
    paths = make_certificates(tmp_path / "tls", 2)
    return Tls(*(str(paths[name]) for name in ("ca.pem", "client.pem", "client.key")))


@pytest.fixture
def settings(tmp_path):
    """Set dask as deploy/jobqueue.yaml does."""
    given = yaml.safe_load((DEPLOY / "jobqueue.yaml").read_text())
    for table in given["jobqueue"].values():
        table["shared-temp-directory"] = str(tmp_path)
    with dask.config.set(dask.config.merge(dask.config.config, given)):
        yield


@pytest.fixture
def commands(tmp_path, monkeypatch):
    """Put commands of batch systems on the path that refuse every job."""
    for command in COMMANDS.values():
        (tmp_path / command).write_text("#!/bin/sh\necho 'no such partition' >&2\nexit 1\n")
        (tmp_path / command).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    return tmp_path


@pytest.mark.processes
@pytest.mark.parametrize("kind", COMMANDS)
@pytest.mark.parametrize("given", [True, False], ids=["given", "temporary"])
def test_job_script(kind, given, settings, commands, tls, monkeypatch):
    """A job's script is shell, starts a single-threaded worker a core, over TLS, with no page for strangers."""
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Has well")
    cluster = Cluster(kind=kind, workers=4, tls=tls if given else None)
    with job_certificates(cluster) as certificates, job_cluster(cluster, certificates) as jobs:
        script = jobs.job_script()
        assert jobs.scheduler_address.startswith("tls://")
        subprocess.run(["bash", "-n"], input=script, text=True, check=True)
        [line] = [line for line in script.splitlines() if "dask_worker" in line]
        words = shlex.split(line.replace("$TMPDIR", "/tmp"))
        assert words[words.index("--nthreads") + 1] == "1"
        assert words[words.index("--nworkers") + 1] == "16"
        assert words[words.index("--protocol") + 1] == "tls://"
        assert words[words.index("--dashboard-address") + 1] == "127.0.0.1:0"
        assert "--no-dashboard" in words
        assert "export OPENBLAS_CORETYPE='Has well'" in script.splitlines()
        key = Path(words[words.index("--tls-key") + 1])
        assert (str(key) == tls.key) == given
        assert key.stat().st_mode & 0o777 == 0o600
        assert "lifetime" in line


def test_a_refused_job_is_told(settings, commands):
    """What the batch system says reaches the user, and nothing is left running."""
    with pytest.raises(UnreachableError, match="no such partition"), connect(Cluster(kind="slurm", workers=16)):
        pass
    assert not list(commands.glob(".clearcap-tls-*"))


@pytest.mark.processes
@pytest.mark.parametrize("kind", COMMANDS)
def test_what_would_be_submitted(kind, settings, commands):
    """The number of jobs and their script; nothing is submitted, for the batch system would refuse it."""
    for workers, jobs in ((16, "1 job"), ((17, 17), "2 jobs"), ((2, 40), "1 to 3 jobs")):
        text = submission(Cluster(kind=kind, workers=workers))
        assert text.startswith(f"{jobs} by {COMMANDS[kind]}")
        assert "--nworkers 16" in text
        subprocess.run(["bash", "-n"], input=text.split("\n", 1)[1], text=True, check=True)
    assert not list(commands.glob(".clearcap-tls-*"))


def test_the_cluster_that_would_be_created():
    """With as many workers as are wanted."""
    with dask.config.set({"kubernetes.custom-cluster-spec": str(DEPLOY / "kubernetes/base/cluster.yaml")}):
        made = yaml.safe_load(submission(Cluster(kind="kubernetes", workers=7)))
    assert (made["kind"], made["spec"]["worker"]["replicas"]) == ("DaskCluster", 7)


def test_what_must_be_said(settings, commands, monkeypatch):
    """The number of workers, a job's size, a folder for certificates, and a place where jobs can be submitted."""
    with pytest.raises(SpecError, match="--workers N"):
        job_cluster(Cluster(kind="slurm"), None)
    for key in ("cores", "memory", "shared-temp-directory"):
        with (
            dask.config.set({f"jobqueue.pbs.{key}": None}),
            pytest.raises(SpecError, match=f"jobqueue.pbs.{key}: not"),
            connect(Cluster(kind="pbs", workers=1)),
        ):
            pass
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(UnreachableError, match="command oarsub not found"):
        job_cluster(Cluster(kind="oar", workers=1), None)


@pytest.mark.parametrize(("kind", "package"), [("slurm", "dask_jobqueue"), ("kubernetes", "dask_kubernetes")])
def test_a_missing_package_is_named(kind, package, monkeypatch):
    """Who has not installed an extra is told which."""
    monkeypatch.setitem(sys.modules, package, None)
    extra = package.removeprefix("dask_")
    with pytest.raises(SpecError, match=rf"clearcap\[{extra}\]"), connect(Cluster(kind=kind, workers=1)):
        pass


@pytest.mark.processes
def test_a_package_of_dask_leaves_ctrl_c_alone():
    """On import, dask-jobqueue has Ctrl-C end the process in silence, as if all were well."""
    code = (
        "import signal\nfrom campaign.cluster.batch_systems import _package\n"
        "_package('dask_jobqueue', 'jobqueue', 'slurm')\n"
        "assert signal.getsignal(signal.SIGINT) is signal.default_int_handler\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.fixture(scope="module")
def kubernetes(tmp_path_factory):
    """Serve the API of Kubernetes; 9 workers are too many for it."""
    with kubernetes_api(tmp_path_factory.mktemp("kubernetes"), refused=9) as api:
        yield api


@pytest.fixture
def api(kubernetes, monkeypatch):
    """Return the API with nothing in it, the shipped manifest being named in dask's configuration."""
    kubernetes.resources.clear()
    kubernetes.changes.clear()
    monkeypatch.setenv("KUBECONFIG", str(kubernetes.config))
    with dask.config.set({"kubernetes.custom-cluster-spec": str(DEPLOY / "kubernetes/base/cluster.yaml")}):
        yield kubernetes


@pytest.mark.processes
def test_kubernetes(api, tls):
    """The resource is created with as many workers as asked for, and deleted at the end; one that is there stays."""
    with kubernetes_resource(Cluster(kind="kubernetes", workers=7, tls=tls)) as address:
        assert address == "tls://clearcap-scheduler.labs.svc:8786"
        assert api.changes == [("created", "clearcap", 7)]
        with kubernetes_resource(Cluster(kind="kubernetes", tls=tls)) as again:
            assert again == address
        assert len(api.changes) == 1
    assert api.changes[1:] == [("deleted", "clearcap")]


@pytest.mark.processes
def test_kubernetes_says_no(api, tls, monkeypatch):
    """No certificates, no manifest, a refusal, pods that never come: each is a message, and nothing stays."""
    with pytest.raises(SpecError, match="needs certificates"), connect(Cluster(kind="kubernetes")):
        pass
    with pytest.raises(UnreachableError, match="refused"), connect(Cluster(kind="kubernetes", workers=9, tls=tls)):
        pass
    with (
        dask.config.set({"kubernetes.custom-cluster-spec": str(DEPLOY / "kubernetes/base/storage.yaml")}),
        pytest.raises(SpecError, match="not the manifest"),
        connect(Cluster(kind="kubernetes", tls=tls)),
    ):
        pass
    monkeypatch.setattr(campaign.cluster.connect, "PODS_WITHIN", 0.5)
    with pytest.raises(UnreachableError, match="not reached"), connect(Cluster(kind="kubernetes", tls=tls)):
        pass
    assert api.changes == [("created", "clearcap", 4), ("deleted", "clearcap")]
