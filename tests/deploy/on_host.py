"""What test_hosts.py does on its hosts: ``python -m tests.deploy.on_host WHAT ...`` prints JSON."""

import json
import logging
import os
import socket
import ssl
import sys
from functools import partial
from pathlib import Path

from botocore.exceptions import EndpointConnectionError
from pyarrow.feather import write_feather
from s3fs import S3FileSystem

import campaign.cluster.connect
from campaign.cluster.cluster import Cluster, Tls
from campaign.cluster.connect import connect
from campaign.coordinator.coordinate import coordinate
from campaign.errors import CampaignError
from campaign.store import open_store
from tests.campaign import fake_engine
from tests.deploy.campaigns import planned, rows
from tests.until import until


def compute(address, url, campaign_id):
    """Compute a planned campaign by a scheduler's two workers, with certificates of dask's configuration."""
    return _compute(Cluster(address), 2, url, campaign_id)


def submit(kind, workers, url, campaign_id):
    """Compute a planned campaign by jobs of a batch system."""
    return _compute(Cluster(kind=kind, workers=int(workers)), int(workers), url, campaign_id)


def submit_slowly(kind, workers, seconds, url, campaign_id):
    """Compute a planned campaign by jobs of a batch system, of runs that take so long."""
    store = open_store(url)
    simulate = partial(fake_engine.takes, float(seconds))
    outcome = coordinate(store, store.plan(campaign_id), Cluster(kind=kind, workers=int(workers)), simulate=simulate)
    return {"batches": sorted(outcome.survey.parts)}


def compute_slowly(address, seconds, url, campaign_id):
    """Compute a planned campaign by a running scheduler, of runs that take so long; say on standard error how it is."""
    logging.basicConfig(format="%(message)s", level=logging.INFO)
    store = open_store(url)
    simulate = partial(fake_engine.takes, float(seconds))
    outcome = coordinate(store, store.plan(campaign_id), Cluster(address), simulate=simulate)
    return {"batches": sorted(outcome.survey.parts)}


def plan_in_bucket(bucket, folder):
    """Plan a campaign in a new bucket of a server that speaks S3 and is being started."""
    until(lambda: _is_made(bucket), "no server")
    store, plan = planned(Path(folder), f"s3://{bucket}/runs")
    return {"url": store.url, "campaign": plan.campaign_id}


def _is_made(bucket):
    """Return whether a bucket is there, and make it if the server answers."""
    try:
        S3FileSystem().mkdir(bucket)
    except (OSError, EndpointConnectionError):  # nobody listens yet
        return False
    return True


def keep_rows(url, campaign_id, file):
    """Write the rows of a campaign that must not depend on where it is computed into a file; return their number."""
    store = open_store(url)
    table = rows(store, store.plan(campaign_id))
    write_feather(table, file)
    return table.num_rows


def run_as_told(campaign_id, *words):
    """Compute a planned campaign as ``clearcap run`` would with these words, when all nodes of the job have workers."""
    verb, _, *options = words
    given = dict(zip(options[::2], options[1::2], strict=True))
    tls = Tls(*(given[f"--tls-{name}"] for name in ("ca", "cert", "key")))
    assert verb == "run"
    seconds = float(os.environ.get("SECONDS_A_RUN", "0"))
    simulate = partial(fake_engine.takes, seconds) if seconds else fake_engine.simulate
    nodes = int(os.environ.get("SLURM_JOB_NUM_NODES", "1"))
    return _compute(Cluster(given["--scheduler"], tls=tls), 1, given["--store"], campaign_id, simulate, nodes)


def _compute(cluster, workers, url, campaign_id, simulate=fake_engine.simulate, on=1):
    """Compute a planned campaign by workers on so many hosts; return by which hosts, and what was computed."""
    store, hosts = open_store(url), []
    plan = store.plan(campaign_id)
    if cluster.scheduler:
        with connect(cluster) as (client, _):
            client.wait_for_workers(workers, timeout=600)
            until(lambda: len(_hosts(client)) >= on, "too few hosts")
            hosts = _hosts(client)
    outcome = coordinate(store, plan, cluster, simulate=simulate)
    return {"hosts": hosts, "statuses": outcome.survey.statuses, "batches": sorted(outcome.survey.parts)}


def _hosts(client):
    """Return the hosts of all workers, in order."""
    return sorted({worker["host"] for worker in client.scheduler_info(n_workers=-1)["workers"].values()})


def reach(address, *files):
    """Try to reach a scheduler, with certificates or without."""
    campaign.cluster.connect.REACHED_WITHIN = 3.0
    tls = Tls(*files) if files else None
    try:
        with connect(Cluster(address, tls=tls, insecure=True)) as (client, _):
            return {"reached": client.scheduler.address}
    except CampaignError as error:
        return {"refused": f"{type(error).__name__}: {error}"}


def knock(host, port):
    """Speak to a port without a certificate, in the clear and over TLS; return what it answers."""
    with socket.create_connection((host, int(port)), timeout=600) as plain:
        plain.sendall(b"GET / HTTP/1.0\r\n\r\n")
        clear = read(plain)
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with socket.create_connection((host, int(port)), timeout=600) as plain, context.wrap_socket(plain) as secured:
            secured.sendall(b"GET / HTTP/1.0\r\n\r\n")
            anonymous = read(secured)
    except OSError as error:
        anonymous = f"refused: {error}"
    return {"clear": clear, "anonymous": anonymous}


def read(connection):
    """Return the first bytes that come, as hexadecimal digits."""
    try:
        return connection.recv(64).hex()
    except ConnectionResetError:
        return ""


VERBS = {
    verb.__name__: verb
    for verb in (compute, compute_slowly, submit, submit_slowly, run_as_told, reach, knock, plan_in_bucket, keep_rows)
}

if __name__ == "__main__":
    json.dump(VERBS[sys.argv[1]](*sys.argv[2:]), sys.stdout)
