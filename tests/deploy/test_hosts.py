"""A campaign on four hosts: scheduler, coordinator and two workers, with nothing between them but mutual TLS."""

import json
import os
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from campaign.cluster.tls_certificates import make_certificates
from tests.campaign.cluster_processes import scheduler, worker
from tests.deploy.campaigns import computed_here, planned, rows
from tests.deploy.hosts import inside, network
from tests.until import until

ROOT = Path(__file__).parents[2]
PORT = 8786

pytestmark = [
    pytest.mark.processes,
    pytest.mark.slow,
    pytest.mark.skipif(
        os.getuid() != 0 or not shutil.which("ip") or not shutil.which("ss"),
        reason="network namespaces need root, and ip and ss of iproute2",
    ),
]


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
    """Return the environment of all hosts: deploy/dask.yaml with certificates made for this test."""
    folder = tmp_path_factory.mktemp("etc")
    make_certificates(folder / "tls", 2)
    config = (ROOT / "deploy/dask.yaml").read_text().replace("/etc/clearcap/tls", str(folder / "tls"))
    (folder / "dask.yaml").write_text(config)
    # the engine of these tests compiles nothing
    return {"DASK_CONFIG": str(folder / "dask.yaml"), "DASK_DISTRIBUTED__NANNY__PRELOAD": "[]"}


@pytest.fixture(scope="module")
def hosts(settings, tmp_path_factory):
    """Start scheduler and workers on hosts of their own; yield namespace and address of each by name."""
    with ExitStack() as stack:
        hosts = stack.enter_context(network(["scheduler", "one", "two", "coordinator"]))
        name, address = hosts["scheduler"]
        where = {"prefix": inside(name), "environment": settings}
        stack.enter_context(scheduler(PORT, "--protocol=tls", host=address, **where))
        for number in ("one", "two"):
            where = {"prefix": inside(hosts[number][0]), "environment": settings}
            scratch = tmp_path_factory.mktemp(number)
            stack.enter_context(worker(f"tls://{address}:{PORT}", scratch, "--protocol=tls", **where))
        yield hosts


@pytest.fixture
def on_host(hosts, settings):
    """Return what runs a function of on_host.py on a host."""

    def run(name, *words):
        command = [*inside(hosts[name][0]), sys.executable, "-m", "tests.deploy.on_host", *map(str, words)]
        environment = {**os.environ, **settings}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


def test_same_rows_as_here(hosts, on_host, tmp_path):
    """Computed by both worker hosts, each row once, the table is that of this machine's workers to the bit."""
    shared, plan = planned(tmp_path, "shared")
    address = f"tls://{hosts['scheduler'][1]}:{PORT}"
    told = on_host("coordinator", "compute", address, shared.url, plan.campaign_id)
    assert told == {
        "hosts": [hosts["one"][1], hosts["two"][1]],
        "statuses": {"ok": 60},
        "batches": list(range(len(plan.batches))),
    }
    assert rows(shared, plan).num_rows == 60
    assert rows(shared, plan).equals(computed_here(tmp_path))


def test_strangers_are_refused(hosts, on_host, settings, tmp_path):
    """Who has no certificate of this cluster's authority reaches nothing; who has one does."""
    address = f"{hosts['scheduler'][1]}:{PORT}"
    ours, theirs = Path(settings["DASK_CONFIG"]).parent / "tls", tmp_path / "theirs"
    make_certificates(theirs, 2)
    files = {f: [f / name for name in ("ca.pem", "client.pem", "client.key")] for f in (ours, theirs)}
    assert on_host("coordinator", "reach", f"tls://{address}", *files[ours]) == {"reached": f"tls://{address}"}
    assert "same authority" in on_host("coordinator", "reach", f"tls://{address}", *files[theirs])["refused"]
    mixed = (files[ours][0], *files[theirs][1:])
    assert "not reached" in on_host("coordinator", "reach", f"tls://{address}", *mixed)["refused"]
    assert "not reached" in on_host("coordinator", "reach", f"tcp://{address}")["refused"]


def test_nothing_listens_in_the_clear(hosts, on_host):
    """Whatever port is open to other hosts answers neither plain words nor TLS without a certificate."""
    until(lambda: {name for name, _ in _ports(hosts)} >= {"scheduler", "one", "two"}, "not all listen", pause=0.2)
    ports = _ports(hosts)
    assert ("scheduler", str(PORT)) in ports
    assert {name for name, _ in ports} == {"scheduler", "one", "two"}
    for name, port in ports:
        answer = on_host("coordinator", "knock", hosts[name][1], port)
        assert answer["clear"] == "" or answer["clear"].startswith("15"), (name, port, answer)  # 0x15: a TLS alert
        assert answer["anonymous"] == "" or "refused" in answer["anonymous"], (name, port, answer)


def _ports(hosts):
    """Return the ports that each host has open to others."""
    ports = []
    for name in ("scheduler", "one", "two", "coordinator"):
        command = [*inside(hosts[name][0]), "ss", "-Hltn"]
        listening = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
        bound = [line.split()[3].rpartition(":") for line in listening]
        ports += [(name, port) for address, _, port in bound if address not in ("127.0.0.1", "[::1]")]
    return ports
