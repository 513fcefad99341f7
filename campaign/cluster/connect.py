"""Connect to workers: started here, of a running dask scheduler, or jobs of a batch system or of Kubernetes.

Traffic beyond this machine needs mutual TLS unless the user gives ``--insecure``, because anyone who can connect to a
dask scheduler can run any code on its workers. The only check that dask makes is for a certificate of the cluster's own
authority.
"""

import asyncio
import json
import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import dask
from distributed import Client, Security
from distributed.comm.core import connect as open_comm
from distributed.utils import silence_logging_cmgr

from campaign.cluster.batch_systems import batch_jobs, kubernetes_resource
from campaign.cluster.cluster import BATCH_SYSTEMS, KINDS, NEEDED, Cluster, configured, security
from campaign.cluster.job_replacement import JobReplacement
from campaign.cluster.local import SETTINGS, interrupts_held, local_client
from campaign.errors import SpecError, UnreachableError
from campaign.processes import cores, is_loopback

logger = logging.getLogger(__name__)

REACHED_WITHIN = 30.0  # s for a scheduler that is starting to answer
PODS_WITHIN = 300.0  # s; images may have to be fetched first


def check_cluster(cluster: Cluster) -> None:
    """Refuse options that contradict each other or allow unencrypted traffic, before any work is done."""
    if cluster.kind not in KINDS:
        raise SpecError(f"--cluster {cluster.kind}: not a kind of cluster; allowed: {', '.join(KINDS)}")
    if cluster.scheduler is not None and cluster.kind != "local":
        raise SpecError(
            f"--scheduler {cluster.scheduler} with --cluster {cluster.kind}: --scheduler uses the workers of a"
            " running scheduler, --cluster starts workers; keep one of them"
        )
    if cluster.follows_work and cluster.kind not in BATCH_SYSTEMS:
        raise SpecError(
            f"--workers {cluster.workers_text}: only jobs of a batch system come and go with the work; give one number,"
            f" or --cluster {', '.join(BATCH_SYSTEMS)}"
        )
    if cluster.scheduler is not None and cluster.workers is not None:
        raise SpecError(
            f"--workers {cluster.workers_text} with --scheduler {cluster.scheduler}: a running scheduler has its own"
            " workers; leave --workers out"
        )
    if cluster.scheduler is not None and not _is_file(cluster.scheduler):
        _check_address(cluster.scheduler, cluster)


@contextmanager
def connect(cluster: Cluster) -> Iterator[tuple[Client, JobReplacement | None]]:
    """Start or reach a cluster; yield a dask client to it, and the jobs of a batch system that are its workers."""
    # Everything started here ends with the block; a scheduler that was running before is left running. If the scheduler
    # is lost, the block can be left as usual, and another call connects again.
    check_cluster(cluster)
    if cluster.scheduler is not None:
        with _existing(cluster.scheduler, cluster) as client:
            yield client, None
    elif cluster.kind == "local":
        with local_client(cluster.most or cores(), security(cluster.tls) if cluster.tls else None) as client:
            yield client, None
    elif cluster.kind == "kubernetes":
        with (
            kubernetes_resource(cluster) as address,
            client_at(address, None if cluster.insecure else security(cluster.tls), PODS_WITHIN) as client,
        ):
            yield client, None
    else:
        with batch_jobs(cluster) as (client, jobs):
            yield client, jobs


@contextmanager
def _existing(scheduler: str, cluster: Cluster) -> Iterator[Client]:
    address = _address_in(Path(scheduler)) if _is_file(scheduler) else scheduler
    _check_address(address, cluster)
    if address.startswith("tcp://") and not cluster.insecure:
        logger.warning(
            "--scheduler %s: not encrypted; every user of this machine can run code as you on its workers, unless you"
            " start it with certificates and write tls:// (clearcap certificates makes them)",
            address,
        )
    with client_at(address, security(cluster.tls) if address.startswith("tls://") else None) as client:
        yield client


@contextmanager
def client_at(address: str, with_security: Security | None, within: float | None = None) -> Iterator[Client]:
    """Yield a client to a scheduler; UnreachableError if it does not answer in time or rejects the certificate."""
    within = within or REACHED_WITHIN
    with dask.config.set(SETTINGS), silence_logging_cmgr(logging.CRITICAL):
        _reach(address, with_security, within)
        try:
            with interrupts_held():
                client = Client(  # type: ignore[no-untyped-call]  # distributed is annotated in parts
                    address, security=with_security, timeout=within, set_as_default=False
                )
        except OSError as error:
            raise UnreachableError(_unreached(address, error)) from error
        try:
            yield client
        finally:
            client.close()  # type: ignore[no-untyped-call]


def _is_file(scheduler: str) -> bool:
    return scheduler.endswith(".json")


def _address_in(path: Path) -> str:
    """Return the address that a scheduler wrote into its file; wait for the file, as the scheduler may be starting."""
    until = time.monotonic() + REACHED_WITHIN
    while True:
        try:
            return str(json.loads(path.read_text(encoding="utf-8"))["address"])
        except FileNotFoundError:
            problem = f"--scheduler {path}: no such file after {REACHED_WITHIN:.0f} s"
        except OSError as error:
            raise SpecError(f"--scheduler {path}: cannot be read ({error.strerror})") from error
        except (ValueError, KeyError, TypeError):  # half written, or something else
            problem = f"--scheduler {path}: not a file written by dask scheduler --scheduler-file"
        if time.monotonic() > until:
            raise UnreachableError(f"{problem}; start the scheduler, or give its address, tls://host:port")
        time.sleep(0.1)


def _check_address(address: str, cluster: Cluster) -> None:
    """Raise SpecError for an invalid address, and for an address beyond this machine without TLS."""
    try:
        parts = urlsplit(address)
        whole = parts.scheme in ("tcp", "tls") and parts.hostname and parts.port and not parts.path
    except ValueError:
        whole = None
    if not whole:
        raise SpecError(
            f"--scheduler {address}: not an address; allowed: tls://host:port, tcp://host:port, or the path of a"
            " scheduler file"
        )
    if parts.scheme == "tls":
        if not (cluster.tls or configured()):
            raise SpecError(f"--scheduler {address}: {NEEDED}")
    elif cluster.tls:
        raise SpecError(f"--scheduler {address}: tcp is not encrypted and would not use the certificates; write tls://")
    elif not (cluster.insecure or is_loopback(parts.hostname or "")):
        raise SpecError(
            f"--scheduler {address}: not encrypted beyond this machine, so that anyone could run code on the workers;"
            " use tls:// with --tls-ca, --tls-cert and --tls-key (clearcap certificates makes them), or add --insecure"
        )


def _reach(address: str, with_security: Security | None, within: float) -> None:
    """Shake hands with the scheduler before a client is made, because a client that fails leaves its thread behind."""
    arguments = with_security.get_connection_args("client") if with_security else {}  # type: ignore[no-untyped-call]

    async def shake_hands() -> None:
        async with asyncio.timeout(within + 1.0):
            comm = await open_comm(address, timeout=within, **arguments)  # type: ignore[no-untyped-call]
            await comm.close()

    try:
        asyncio.run(shake_hands())
    except (OSError, RuntimeError, ValueError) as error:
        raise UnreachableError(_unreached(address, error)) from error


def _unreached(address: str, error: BaseException) -> str:
    """Return the message about a scheduler that did not answer, with the innermost cause that has a text."""
    reason = type(error).__name__
    cause: BaseException | None = error
    while cause is not None:
        reason, cause = str(cause) or reason, cause.__cause__
    return (
        f"scheduler {address}: not reached ({reason}); check that it runs and that its certificate and yours are of the"
        " same authority"
    )
