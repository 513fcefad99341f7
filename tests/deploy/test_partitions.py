"""The network between coordinator, scheduler and a worker is gone for a while: no row is, and the user is told."""

import json
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from pyarrow.feather import read_table

from campaign.cluster.tls_certificates import make_certificates
from campaign.coordinator.heartbeat import Heartbeat
from campaign.store.layout import HEARTBEAT
from tests.campaign.cluster_processes import process, tls_arguments
from tests.campaign.store.files.test_s3 import ACCESS
from tests.deploy.campaigns import computed_here, planned, rows
from tests.deploy.hosts import cut_off, inside, network, unanswered
from tests.deploy.test_hosts import pytestmark  # noqa: F401  # what these tests need
from tests.until import until

ROOT = Path(__file__).parents[2]


def address_in(file):
    """Return the address that a scheduler has written; None as long as it has not."""
    try:
        return json.loads(file.read_text())["address"]
    except (FileNotFoundError, ValueError):
        return None


@pytest.fixture
def hosts(tmp_path):
    """Start a scheduler with a worker, and a worker elsewhere as the job scripts do; yield hosts and settings."""
    make_certificates(tmp_path / "tls", 2)
    config = (ROOT / "deploy/dask.yaml").read_text().replace("/etc/clearcap/tls", str(tmp_path / "tls"))
    (tmp_path / "dask.yaml").write_text(config)
    settings = {"DASK_CONFIG": str(tmp_path / "dask.yaml"), "DASK_DISTRIBUTED__NANNY__PRELOAD": "[]"}
    settings |= {"TMPDIR": str(tmp_path), "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    file = tmp_path / "scheduler.json"
    closed = ["--no-dashboard", "--dashboard-address=127.0.0.1:0", "--protocol=tls"]
    with ExitStack() as stack:
        hosts = stack.enter_context(network(["scheduler", "two", "coordinator", "store"]))
        settings |= {**ACCESS, "AWS_ENDPOINT_URL": f"http://{hosts['store'][1]}:9000"}
        serves = {"prefix": inside(hosts["store"][0]), "environment": {"S3_HOST": hosts["store"][1]}}
        stack.enter_context(process("tests.campaign.s3_server", 9000, **serves))
        where = {"prefix": inside(hosts["scheduler"][0]), "environment": settings}
        words = [
            "distributed.cli.dask_scheduler",
            f"--host={hosts['scheduler'][1]}",
            f"--scheduler-file={file}",
            *closed,
        ]
        stack.enter_context(process(*words, *tls_arguments(tmp_path / "tls", "scheduler"), **where))
        address = until(lambda: address_in(file), "no scheduler")
        for name in ("scheduler", "two"):
            worker = ["dask", "worker", "--scheduler-file", file, "--nworkers", 1, "--nthreads", 1, "--name", name]
            words = [*worker, *closed, "--death-timeout", 600, *tls_arguments(tmp_path / "tls", "worker")]
            command = [*inside(hosts[name][0]), ROOT / "deploy/batch/on_node.sh", *words]
            with (tmp_path / name).open("w") as log:
                started = subprocess.Popen(list(map(str, command)), env=os.environ | settings, stdout=log, stderr=log)
            stack.callback(started.wait)
            stack.callback(started.terminate)
        stack.callback(file.unlink)
        yield hosts, settings, address


@pytest.mark.parametrize(("who", "seconds"), [("coordinator", 30.0), ("coordinator", 90.0), ("two", 90.0)])
def test_a_partition(hosts, tmp_path, who, seconds):
    """Rows are those of this machine, each once; who was cut off is named, and comes back by itself."""
    (names, settings, address), (store, plan) = hosts, planned(tmp_path, "shared")
    words = ("compute_slowly", address, "4", store.url, plan.campaign_id)
    command = [*inside(names["coordinator"][0]), sys.executable, "-m", "tests.deploy.on_host", *words]
    with (tmp_path / "said").open("w") as log:
        told = subprocess.Popen(command, cwd=ROOT, env=os.environ | settings, stdout=log, stderr=log)
    try:
        until(lambda: told.poll() is not None or store.survey(plan).parts, (tmp_path / "said").read_text)
        waits, end = set(), time.monotonic() + seconds
        with cut_off(*names[who]):
            while time.monotonic() < end:
                beat = Heartbeat.from_json(store.read_json(plan.campaign_id, HEARTBEAT) or {})
                waits |= {wait["what"] for wait in beat.waiting} if beat else set()
                time.sleep(1.0)
        assert told.wait(1200) == 0, (tmp_path / "said").read_text()
    finally:
        told.kill()
    said = (tmp_path / "said").read_text()
    assert rows(store, plan).equals(computed_here(tmp_path)), said
    if seconds > 60.0:
        assert ("lost the scheduler" if who == "coordinator" else "worker two on 10.77.0.2 is lost, 1 left") in said
        assert ("scheduler" if who == "coordinator" else "lost") in waits
    if who == "two":
        assert "worker two on 10.77.0.2 joined, 2 now" in said


@pytest.mark.parametrize("who", ["coordinator", "two"])
def test_a_partition_from_the_store(hosts, tmp_path, who):
    """One host hears nothing of the store for 90 s, though all else is reached: rows are those of this machine."""
    names, settings, address = hosts

    def ask(*words):
        command = [*inside(names["store"][0]), sys.executable, "-m", "tests.deploy.on_host", *map(str, words)]
        done = subprocess.run(command, cwd=ROOT, env=os.environ | settings, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    plan = ask("plan_in_bucket", "away", tmp_path)
    words = ("compute_slowly", address, "4", plan["url"], plan["campaign"])
    command = [*inside(names["coordinator"][0]), sys.executable, "-m", "tests.deploy.on_host", *words]
    with (tmp_path / "said").open("w") as log:
        told = subprocess.Popen(command, cwd=ROOT, env=os.environ | settings, stdout=log, stderr=log)
    try:
        there = (plan["url"], plan["campaign"], tmp_path / "rows")
        until(lambda: told.poll() is not None or ask("keep_rows", *there), (tmp_path / "said").read_text, pause=1.0)
        with unanswered(names["store"][0], names[who][1]):
            time.sleep(90.0)
        assert told.wait(1200) == 0, (tmp_path / "said").read_text()
        assert ask("keep_rows", *there) == 60
    finally:
        told.kill()
    said = (tmp_path / "said").read_text()
    assert read_table(tmp_path / "rows").equals(computed_here(tmp_path)), said
    assert ("trying again for 180 s" in said, "answers again" in said) == (who == "coordinator",) * 2, said
