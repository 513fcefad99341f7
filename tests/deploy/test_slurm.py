"""The job scripts for SLURM and `--cluster slurm`, on a real SLURM."""

import json
import os
import random
import re
import stat
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from campaign.cluster.tls_certificates import make_certificates
from campaign.store import open_store
from engine import jit
from tests.campaign.cluster_processes import process, tls_arguments
from tests.counts import many
from tests.deploy.campaigns import compiled_on_nodes, computed_here, planned, rows
from tests.deploy.hosts import inside
from tests.deploy.slurm import is_here, slurm, wait_for_end
from tests.until import until

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"

pytestmark = [
    pytest.mark.processes,
    pytest.mark.slow,
    pytest.mark.skipif(not is_here(), reason="needs root and SLURM: apt-get install slurm-wlm iproute2"),
]
SMALL = ("--nodes=1", "--cpus-per-task=2", "--mem-per-cpu=1G")


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Return a home folder with certificates, and what the engine has compiled where jobs look for it."""
    home = tmp_path_factory.mktemp("home")
    compiled_on_nodes(home)
    make_certificates(home / ".clearcap/tls", 2)
    return home


@pytest.fixture(scope="module")
def run(tmp_path_factory, home):
    """Return what runs a command where SLURM is, as a user of the certificates would."""
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    user = {"HOME": str(home), "TMPDIR": str(home), "USER": "root", "PATH": path, "PYTHONPATH": str(ROOT)}
    user["NUMBA_CACHE_DIR"] = str(jit.CACHE_FOLDER.parent)
    with slurm(tmp_path_factory.mktemp("slurm"), ("n1", "n2")) as plain:

        def run(*words, **more):
            return plain(*words, **(user | more))

        run.host = plain.host
        yield run


def test_accepts_the_job_scripts(run, tmp_path):
    """SLURM itself parses the directives and would start the jobs as they are, on fewer nodes."""
    for script in ("campaign.slurm", "workers.slurm"):
        said = run("sbatch", "--test-only", "--nodes=1", DEPLOY / "batch" / script)
        assert "to start at" in said
        assert "using 16 processors" in said
    broken = tmp_path / "broken.slurm"
    broken.write_text((DEPLOY / "batch/campaign.slurm").read_text().replace("--mem-per-cpu", "--memory-per-cpu"))
    with pytest.raises(AssertionError, match="memory-per-cpu"):
        run("sbatch", "--test-only", "--nodes=1", broken)


def allocation(run, tmp_path, store, plan, *options, **environment):
    """Submit campaign.slurm for a plan that the engine's stand-in computes; return the job."""
    binaries = tmp_path / "bin"
    binaries.mkdir(exist_ok=True)
    stand_in = binaries / "clearcap"  # computes the plan with the engine's stand-in
    stand_in.write_text(
        f'#!/bin/sh\nexec {sys.executable} -m tests.deploy.on_host run_as_told {plan.campaign_id} "$@"\n'
    )
    stand_in.chmod(stand_in.stat().st_mode | stat.S_IXUSR)
    return run(
        *("sbatch", "--parsable", *SMALL, *options, f"--output={tmp_path}/log", "--open-mode=append"),
        DEPLOY / "batch/campaign.slurm",
        PATH=f"{binaries}:{Path(sys.executable).parent}:{os.environ['PATH']}",
        **{"CAMPAIGN": "demo", "STORE": store.url, "CLEARCAP_DEPLOY": str(DEPLOY), **environment},
    ).strip()


def test_a_campaign_in_one_allocation(run, tmp_path):
    """campaign.slurm starts scheduler, workers and the coordinator, on both nodes; nothing stays when it is done.

    Its log has nothing that looks like a failure.
    """
    store, plan = planned(tmp_path, "shared")
    job = allocation(run, tmp_path, store, plan, "--nodes=2", SECONDS_A_RUN="2")
    log = tmp_path / "log"
    assert wait_for_end(run, job) == "COMPLETED", log.read_text()
    assert rows(store, plan).equals(computed_here(tmp_path)), log.read_text()
    assert not run("squeue", "--noheader")
    said = log.read_text()
    ending = said.partition('"statuses"')[2]  # after what the command prints at its end
    assert ending
    assert not re.search("Traceback|Killed|CANCELLED|[Ee]rror|forcing", ending), said
    assert "10.77.0.1" in said
    assert "10.77.0.2" in said


def test_what_slurm_does_to_an_allocation(run, tmp_path):
    """It is put back into the queue and starts again; its walltime ends; the same job again computes the rest."""
    store, plan = planned(tmp_path, "shared")
    log, parts = tmp_path / "log", lambda: len(store.survey(plan).parts)
    job = allocation(run, tmp_path, store, plan, "--requeue", SECONDS_A_RUN="2")
    until(lambda: parts() > 1, log.read_text, pause=0.5)
    run("scontrol", "requeue", job)
    before = parts()
    until(lambda: parts() > before, log.read_text, pause=0.5)
    assert re.search(r"Restarts=1\b", run("scontrol", "show", "job", job))
    run("scontrol", "update", f"jobid={job}", "timelimit=1")  # minutes, since its start
    assert wait_for_end(run, job) in ("TIMEOUT", "FAILED")
    assert store.table(plan.campaign_id).num_rows != 60
    job = allocation(run, tmp_path, store, plan)
    assert wait_for_end(run, job) == "COMPLETED", log.read_text()
    assert rows(store, plan).equals(computed_here(tmp_path)), log.read_text()


def test_workers_as_jobs(run, tmp_path):
    """`--cluster slurm` submits jobs, computes over the temporary certificates it makes, and cancels the jobs."""
    store, plan = planned(tmp_path, "shared")
    shared = tmp_path / "private"
    shared.mkdir()
    job = {"CORES": "1", "MEMORY": "1GB", "SHARED_TEMP_DIRECTORY": str(shared), "LOG_DIRECTORY": str(tmp_path)}
    told = run(
        *(sys.executable, "-m", "tests.deploy.on_host", "submit", "slurm", "2", store.url, plan.campaign_id),
        DASK_CONFIG=str(DEPLOY / "jobqueue.yaml"),
        **{f"DASK_JOBQUEUE__SLURM__{key}": value for key, value in job.items()},
    )
    assert json.loads(told)["batches"] == list(range(len(plan.batches)))
    assert rows(store, plan).equals(computed_here(tmp_path))
    assert not list(shared.iterdir())
    until(lambda: not run("squeue", "--noheader"), "a job stays", pause=0.5)


def test_jobs_that_end_are_replaced(run, tmp_path):
    """All jobs are cancelled by somebody, three times, each time after some rows are stored: it is completed."""
    store, plan = planned(tmp_path, "shared")
    shared = tmp_path / "private"
    shared.mkdir()
    job = {"CORES": "1", "MEMORY": "1GB", "SHARED_TEMP_DIRECTORY": str(shared), "LOG_DIRECTORY": str(tmp_path)}
    words = ("submit_slowly", "slurm", "2", "0.5", store.url, plan.campaign_id)

    def parts():
        return len(store.survey(plan).parts)

    with ThreadPoolExecutor(1) as pool:
        told = pool.submit(
            run,
            *(sys.executable, "-m", "tests.deploy.on_host", *words),
            DASK_CONFIG=str(DEPLOY / "jobqueue.yaml"),
            DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT="1s",
            **{f"DASK_JOBQUEUE__SLURM__{key}": value for key, value in job.items()},
        )
        seen = set()
        for _ in range(3):
            before = parts()
            until(lambda before=before: told.done() or parts() > before, "no part comes", pause=0.2)
            seen |= set(run("squeue", "--noheader", "--format=%i").split())
            run("scancel", "--user=root")
        said = told.result()
    assert len(seen) > 2
    assert f'"batches": {list(range(len(plan.batches)))}' in said
    assert "ended, and will be replaced" in said
    assert rows(store, plan).equals(computed_here(tmp_path))
    until(lambda: not run("squeue", "--noheader"), "a job stays", pause=0.5)


SAMPLES, PARTS = many(2000), 50
C60 = ("run", "c60", "--samples", SAMPLES, "--batch-size", SAMPLES // PARTS, "--no-report", "--store")


def real(run, *words, **environment):
    """Run the command itself; return its messages."""
    return run(sys.executable, "-m", "clearcap", *words, **environment)


def of_store(folder):
    """Return the rows of the only campaign of a store."""
    store = open_store(str(folder))
    return store.table(store.find(None)).drop_columns(["wall_s", "attempts"])


@pytest.fixture(scope="module")
def reference(run, tmp_path_factory):
    """Return the rows of the C-60 as this machine computes them, and for how long a job lasts [s].

    That is 20 s, and more on a busy machine, where a process takes long to load the engine: it must last for a batch.
    """
    store, start = tmp_path_factory.mktemp("reference") / "runs", time.monotonic()
    real(run, *C60, store, "--workers", 2)
    return of_store(store), max(20, int(time.monotonic() - start))


def storm(run, store, told, each):
    """Cancel a job of those that run, at random, each time so many batches have come; drain a node and give it back.

    Return the jobs that were cancelled once the campaign is told to be complete.
    """
    chance, cancelled = random.Random(5), []

    def parts():
        return len(list(store.glob("*/parts/*.parquet")))

    def running():
        return run("squeue", "--noheader", "--states=RUNNING", "--format=%A").split()

    while True:
        due = each * (len(cancelled) + 1)
        until(lambda due=due: told.done() or (parts() >= due and running()), "no rows come", 1200.0, pause=0.5)
        if told.done():
            return cancelled
        cancelled.append(chance.choice(running() or ["1"]))
        run("scancel", "--quiet", cancelled[-1])
        if len(cancelled) in (1, 2):
            state = "drain" if len(cancelled) == 1 else "resume"
            run("scontrol", "update", "nodename=n2", f"state={state}", "reason=test")


def test_jobs_that_come_and_go(run, tmp_path, reference):
    """Workers that soon end, jobs cancelled, a node drained and back: complete, and the same to the bit."""
    (expected, lifetime), shared = reference, tmp_path / "private"
    shared.mkdir()
    job = {"CORES": "1", "MEMORY": "1GB", "SHARED_TEMP_DIRECTORY": str(shared), "LOG_DIRECTORY": str(tmp_path)}
    job["WORKER_EXTRA_ARGS"] = f"['--lifetime', '{lifetime}s', '--lifetime-stagger', '4s']"
    settings = {f"DASK_JOBQUEUE__SLURM__{key}": value for key, value in job.items()}
    settings |= {"DASK_CONFIG": str(DEPLOY / "jobqueue.yaml"), "DASK_DISTRIBUTED__DEPLOY__LOST_WORKER_TIMEOUT": "1s"}
    with ThreadPoolExecutor(1) as pool:
        told = pool.submit(real, run, *C60, tmp_path / "runs", "--cluster", "slurm", "--workers", "2:3", **settings)
        cancelled = storm(run, tmp_path / "runs", told, PARTS // 10)
        said = told.result()
    jobs = set(re.findall(r"JobId=(\d+) ", run("scontrol", "show", "job", "--oneliner")))
    assert of_store(tmp_path / "runs").equals(expected), said
    assert len(cancelled) > 2
    assert len(jobs) > 4, said
    assert "ended, and will be replaced" in said
    assert re.search(r"worker \S+ on 10\.77\.0\.\d joined", said), said
    until(lambda: not run("squeue", "--noheader"), "a job stays", pause=0.5)


def test_an_array_of_workers(run, home, tmp_path):
    """Three elements at a time, for a scheduler that somebody keeps; one is requeued, others are cancelled."""
    (store, plan), file, tls = planned(tmp_path, "shared"), tmp_path / "scheduler.json", home / ".clearcap/tls"
    closed = ["--port=0", "--protocol=tls", "--no-dashboard", "--dashboard-address=127.0.0.1:0"]
    command = ["distributed.cli.dask_scheduler", *closed, f"--scheduler-file={file}"]
    environment = {"SCHEDULER_FILE": str(file), "CLEARCAP_DEPLOY": str(DEPLOY), "CLEARCAP_LIFETIME": "600"}
    small = ("--requeue", "--nodes=1", "--cpus-per-task=1", "--mem-per-cpu=1G", f"--output={tmp_path}/log-%a")
    files = ("--tls-ca", tls / "ca.pem", "--tls-cert", tls / "client.pem", "--tls-key", tls / "client.key")
    words = (plan.campaign_id, "run", "demo", "--store", store.url, "--scheduler", file, *files)

    with process(*command, *tls_arguments(tls, "scheduler"), prefix=inside(run.host)), ThreadPoolExecutor(1) as pool:
        until(file.exists, "no scheduler")
        array = ("sbatch", "--parsable", "--array=1-90%3", *small, DEPLOY / "batch/workers.slurm")
        array = run(*array, **environment).strip()
        compute = (sys.executable, "-m", "tests.deploy.on_host", "run_as_told", *words)
        told = pool.submit(run, *compute, SECONDS_A_RUN="1")
        until(lambda: told.done() or store.survey(plan).parts, "no rows come", 1200.0, pause=0.5)
        again = run("squeue", "--noheader", "--states=RUNNING", "--format=%A").split()[0]
        run("scontrol", "requeue", again)
        cancelled = storm(run, tmp_path / "shared", told, 5)
        assert f'"batches": {list(range(len(plan.batches)))}' in told.result()
        run("scancel", array)
    assert rows(store, plan).equals(computed_here(tmp_path))
    assert len(cancelled) > 1
    assert re.search(r"Restarts=1\b", run("scontrol", "show", "job", again))
    until(lambda: not run("squeue", "--noheader"), "a job stays", pause=0.5)
