"""Workers as jobs of a batch system (SLURM, OAR, PBS) or of Kubernetes, through dask's own packages for these.

Dask's configuration describes a job (queue, project, walltime, memory, image), as usual for those packages, in the
tables ``jobqueue.slurm``, ``jobqueue.oar``, ``jobqueue.pbs`` and ``kubernetes``.
"""

import importlib
import logging
import math
import os
import shlex
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import dask
from distributed import Client, Security, Status

from campaign.cluster.cluster import NEEDED, Cluster, Tls, security
from campaign.cluster.job_replacement import JobReplacement, jobs_replaced
from campaign.cluster.local import CLOSED, NO_DASHBOARD, SETTINGS, interrupts_held, scratch_folder
from campaign.cluster.tls_certificates import LONGEST, make_certificates
from campaign.errors import SpecError, UnreachableError
from campaign.processes import numerical
from campaign.waits import counted

_BATCH_SYSTEMS = {"slurm": "SLURMCluster", "oar": "OARCluster", "pbs": "PBSCluster"}
# HTTP is neither encrypted nor authenticated.
_NO_HTTP = ("--no-dashboard", "--dashboard-address", "127.0.0.1:0", "--preload", NO_DASHBOARD)


@contextmanager
def batch_jobs(cluster: Cluster) -> Iterator[tuple[Client, JobReplacement]]:
    """Start a scheduler here and workers as jobs; yield a client and the jobs, and cancel them at the end."""
    with job_certificates(cluster) as certificates, scratch_folder() as scratch:
        with dask.config.set({**SETTINGS, **CLOSED, "temporary-directory": str(scratch)}), interrupts_held():
            jobs = job_cluster(cluster, certificates)
        try:
            _submit(jobs, cluster)
            with interrupts_held():
                client = Client(jobs, set_as_default=False)  # type: ignore[no-untyped-call]  # annotated in parts
            try:
                with jobs_replaced(jobs, cluster) as replacement:
                    yield client, replacement
            finally:
                client.close()  # type: ignore[no-untyped-call]
        finally:
            jobs.close()


def submission(cluster: Cluster) -> str:
    """Return what would be submitted to a batch system, or to Kubernetes, and how often; nothing is submitted."""
    if cluster.kind == "kubernetes":
        yaml = _package("yaml", "kubernetes", "kubernetes")
        return str(yaml.safe_dump(_scaled_manifest(cluster), sort_keys=False))
    with job_certificates(cluster) as certificates, scratch_folder() as scratch:
        settings = {**SETTINGS, **CLOSED, "temporary-directory": str(scratch)}
        with dask.config.set(settings), job_cluster(cluster, certificates) as jobs:
            each = int(_needed(cluster.kind, "cores"))
            numbers = [math.ceil((workers or 1) / each) for workers in (cluster.least, cluster.most)]
            count = counted(numbers[1], "job") if numbers[0] == numbers[1] else f"{numbers[0]} to {numbers[1]} jobs"
            return f"{count} by {jobs.job_cls.submit_command}, {counted(each, 'worker')} each:\n{jobs.job_script()}"


@contextmanager
def job_certificates(cluster: Cluster) -> Iterator[Security | None]:
    """Yield the certificates of the cluster, or new ones in a folder that its jobs can read; None if insecure."""
    given = security(cluster.tls)
    if given or cluster.insecure:
        yield given
        return
    _package("dask_jobqueue", "jobqueue", cluster.kind)  # loads the defaults of the configuration
    shared = Path(os.path.expandvars(_needed(cluster.kind, "shared-temp-directory"))).expanduser()
    try:
        folder = tempfile.TemporaryDirectory(prefix=".clearcap-tls-", dir=shared)
    except OSError as error:
        raise SpecError(
            f"jobqueue.{cluster.kind}.shared-temp-directory: {shared} cannot be written ({error.strerror});"
            " name a folder of yours that all nodes can reach"
        ) from error
    with folder as made:
        files = make_certificates(Path(made), LONGEST)
        yield security(Tls(*(str(files[name]) for name in ("ca.pem", "client.pem", "client.key"))))


def _submit(jobs: Any, cluster: Cluster) -> None:
    """Submit the jobs and wait for the batch system's answer."""

    async def answered() -> None:
        jobs.scale(cluster.least)
        await jobs._correct_state()  # scale alone does not wait

    with _muted("tornado.application"), _muted("asyncio"):  # they log the same refusal with a traceback
        try:
            jobs.sync(answered)
        except (RuntimeError, OSError) as error:
            for job in jobs.workers.values():
                if job.job_id is None:
                    job.status = Status.failed  # close() accepts only jobs that have ended or failed
            raise UnreachableError(f"--cluster {cluster.kind}: the batch system refused the jobs: {error}") from error


@contextmanager
def _muted(name: str) -> Iterator[None]:
    """Limit a logger to critical messages while the block runs."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def job_cluster(cluster: Cluster, certificates: Security | None) -> Any:
    """Return dask-jobqueue's cluster without jobs yet; a job has one single-threaded worker per core."""
    kind = cluster.kind
    jobqueue = _package("dask_jobqueue", "jobqueue", kind)
    if cluster.workers is None:
        raise SpecError(f"--cluster {kind}: the total number of workers is not given; add --workers N, or MIN:MAX")
    _needed(kind, "memory")
    made: Any = getattr(jobqueue, _BATCH_SYSTEMS[kind])
    command = made.job_cls.submit_command.split()[0]
    if shutil.which(command) is None:
        raise UnreachableError(f"--cluster {kind}: command {command} not found; run clearcap where jobs are submitted")
    exports = [f"export {name}={shlex.quote(value)}" for name, value in numerical().items()]
    return made(
        processes=_needed(kind, "cores"),
        security=certificates,
        job_script_prologue=[*exports, *_setting(kind, "job-script-prologue"), "export PYTHONSAFEPATH=1"],
        worker_extra_args=[*_setting(kind, "worker-extra-args"), *_NO_HTTP],
        scheduler_options=_setting(kind, "scheduler-options")
        | {"dashboard": False, "dashboard_address": "127.0.0.1:0"},
        silence_logs=logging.CRITICAL,
    )


def _needed(kind: str, key: str) -> Any:
    """Return a required setting of a kind of job from dask's configuration."""
    value = _setting(kind, key)
    if not value:
        raise SpecError(
            f"jobqueue.{kind}.{key}: not set; write it into dask's configuration, for example in"
            " ~/.config/dask/jobqueue.yaml; deploy/jobqueue.yaml is an example"
        )
    return value


def _setting(kind: str, key: str) -> Any:
    """Return a setting of a kind of job from dask's configuration, where ``-`` and ``_`` in keys are equivalent."""
    return dask.config.get(f"jobqueue.{kind}.{key}", None)


@contextmanager
def kubernetes_resource(cluster: Cluster) -> Iterator[str]:
    """Yield the scheduler's address, valid inside Kubernetes, of a ``DaskCluster``; delete one that was made here."""
    _package("dask_kubernetes", "kubernetes", "kubernetes")
    kr8s, httpx = (_package(name, "kubernetes", "kubernetes") for name in ("kr8s", "httpx"))
    objects = importlib.import_module("kr8s.objects")
    if security(cluster.tls) is None and not cluster.insecure:
        raise SpecError(f"--cluster kubernetes: {NEEDED}, or add --insecure")
    manifest = _scaled_manifest(cluster)
    made = objects.new_class("DaskCluster", "kubernetes.dask.org/v1", asyncio=False)
    try:
        resource = made(manifest, namespace=dask.config.get("kubernetes.namespace", None))
        created = not resource.exists()
        if created:
            resource.create()
    except (kr8s.ServerError, kr8s.APITimeoutError, kr8s.ConnectionClosedError, httpx.HTTPError, ValueError) as error:
        raise UnreachableError(f"--cluster kubernetes: Kubernetes refused, or does not answer: {error}") from error
    try:
        scheme = "tcp" if cluster.insecure else "tls"
        yield f"{scheme}://{resource.name}-scheduler.{resource.namespace}.svc:8786"
    finally:
        if created and dask.config.get("kubernetes.shutdown-on-close", True):
            resource.delete()


def _scaled_manifest(cluster: Cluster) -> Any:
    """Return the ``DaskCluster`` that dask's configuration names, with as many workers as are wanted."""
    key = "kubernetes.custom-cluster-spec"
    given = dask.config.get(key, None)
    if given is None:
        raise SpecError(
            f"{key}: not set; name the manifest of a DaskCluster in dask's configuration;"
            " deploy/kubernetes/base/cluster.yaml is an example"
        )
    manifest = given
    if not isinstance(given, dict):
        yaml = importlib.import_module("yaml")
        try:
            manifest = yaml.safe_load(Path(given).read_text(encoding="utf-8"))
            manifest["spec"]["worker"]["replicas"] += 0  # an error unless it is a number
        except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError) as error:
            raise SpecError(f"{key} {given}: not the manifest of one DaskCluster ({error})") from error
    if cluster.workers is not None:
        manifest["spec"]["worker"]["replicas"] = cluster.most
    return manifest


def _package(name: str, extra: str, kind: str) -> Any:
    """Return a package of an optional extra, restoring the handler of Ctrl-C, which `dask_jobqueue` replaces."""
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SpecError(
            f"--cluster {kind}: needs the package {name}, which is not installed; pip install 'clearcap[{extra}]'"
        ) from error
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, interrupt)
