"""The store on S3: the same promises, against a server that speaks S3 over HTTP on loopback."""

import os
import random
import secrets
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest
import s3fs

from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.submit import submit
from campaign.errors import SpecError, StoreError
from campaign.store import open_store, part_name
from campaign.store.files import object_store
from campaign.store.files.files import Files
from campaign.store.files.retry_policy import HASTY, RetryPolicy
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from tests.campaign import fake_engine
from tests.campaign.driving import computed, rows
from tests.campaign.store.test_store import fill

pytestmark = pytest.mark.processes

ACCESS = {
    "AWS_ACCESS_KEY_ID": "someone",
    "AWS_SECRET_ACCESS_KEY": "something",
    "AWS_DEFAULT_REGION": "us-east-1",
    "AWS_MAX_ATTEMPTS": "1",  # botocore's own repetitions, so that what is seen to repeat is the store
}


@contextmanager
def s3_server(port=0, busy=0, percent=0, seed=0):
    """Yield the process of a server and its port."""
    command = [sys.executable, "-m", "tests.campaign.s3_server", *map(str, (port, busy, percent, seed))]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as server:
        try:
            yield server, int(server.stdout.readline())
        finally:
            server.kill()


def bucket(monkeypatch, port):
    """Point the environment at a server, as a user would, and return the URL of a new bucket there."""
    for key, value in {**ACCESS, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}"}.items():
        monkeypatch.setenv(key, value)
    s3fs.S3FileSystem.clear_instance_cache()  # which knows the server of the test before
    name = f"bucket-{secrets.token_hex(4)}"
    s3fs.S3FileSystem().mkdir(name)
    return f"s3://{name}/runs"


@pytest.fixture
def url(monkeypatch, s3_port):
    """Return the URL of a store that is empty."""
    return bucket(monkeypatch, s3_port)


@pytest.fixture
def remote(url, plan):
    """Return a store on S3, holding the plan."""
    store = open_store(url)
    store.create_plan(plan)
    return store


@pytest.mark.slow
def test_campaign_and_its_resumption(tmp_path, url, campaign):
    """A campaign of dask workers on S3 has the rows of one in a folder; lost and bad parts are computed again."""
    reference = rows(*computed(tmp_path / "folder", campaign, 5))
    store = open_store(url)
    plan = submit(store, campaign, 5)

    def run():
        return coordinate(store, plan, Cluster(workers=2), simulate=fake_engine.simulate)

    outcome = run()
    assert outcome.computed == 25
    assert rows(store, outcome).equals(reference)
    store.files.remove(part_name(plan, 1))
    store.files.write(part_name(plan, 3), store.files.read(part_name(plan, 3))[:-9])
    outcome = run()
    assert outcome.computed == 10
    assert rows(store, outcome).equals(reference)
    assert "part-000003.parquet.bad" in store.files.names(f"{plan.campaign_id}/parts")
    store.compact(plan)
    assert store.files.names(f"{plan.campaign_id}/parts") == ["part-000003.parquet.bad", "rows-000000-000004.parquet"]
    assert run().computed == 0
    assert open_store(url).table().drop_columns(["wall_s", "attempts"]).equals(reference)


WRITES = """
import sys
from campaign.store import open_store
store = open_store(sys.argv[1])
plan = store.plan(store.find(None))
rows = [store.read_part(plan, batch) for batch in range(3)]
print("go", flush=True)
while True:
    for batch in range(3):
        store.write_part(plan, batch, rows[batch])
"""


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_killed_writer_leaves_whole_parts(remote, plan, seed):
    """Kill -9 of a process that puts parts: each is whole, and there is nothing else."""
    fill(remote, plan)
    whole = remote.table()
    with subprocess.Popen([sys.executable, "-c", WRITES, remote.url], stdout=subprocess.PIPE) as writer:
        writer.stdout.readline()
        time.sleep(random.Random(seed).uniform(0.0, 0.1))
        writer.kill()
    assert remote.files.names(f"{plan.campaign_id}/parts") == [f"part-{batch:06d}.parquet" for batch in range(3)]
    assert remote.survey(plan).bad == {}
    assert remote.table().equals(whole)


@pytest.mark.slow
def test_server_that_is_killed(monkeypatch, plan):
    """A server that dies is a StoreError that says what to do; with it back, the same call succeeds."""
    with s3_server() as (server, port):
        url = bucket(monkeypatch, port)
        store = open_store(url, RetryPolicy(0.5, 0.1))
        store.create_plan(plan)
        fill(store, plan)
        table = store.read_part(plan, 1)
        server.kill()
        server.wait()
        with pytest.raises(StoreError, match=r"part-000001\.parquet"):
            store.write_part(plan, 1, table)
        with pytest.raises(StoreError, match="cannot be read"):
            store.survey(plan)
    with s3_server(port):
        s3fs.S3FileSystem().mkdir(url.split("/")[2])
        store.write_part(plan, 1, table)
        assert store.survey(plan).missing == [0, 2]


@pytest.mark.slow
def test_server_that_comes_back_in_time(monkeypatch, plan):
    """A server that answers nothing for a moment, in mid-write, costs that moment."""
    with s3_server() as (server, port):
        store = open_store(bucket(monkeypatch, port))
        store.create_plan(plan)
        fill(store, plan, [0, 1])
        command = [sys.executable, "-c", "import os,sys,time; time.sleep(1); os.kill(int(sys.argv[1]), 18)"]
        os.kill(server.pid, signal.SIGSTOP)
        with subprocess.Popen([*command, str(server.pid)]):
            fill(store, plan, [2])
        assert store.survey(plan).missing == []


@pytest.mark.slow
def test_busy_server(monkeypatch, plan, campaign):
    """Every third request is answered "slow down", and no call fails."""
    with s3_server(busy=3) as (_, port):
        store = open_store(bucket(monkeypatch, port), RetryPolicy(600.0, 0.01))
        monkeypatch.setattr(s3fs.S3FileSystem, "retries", 1)
        assert store.create_plan(plan) == plan
        fill(store, plan)
        assert store.survey(plan).missing == []
        assert len(store.table()) == 25


CREATES = """
import sys
from campaign.store import open_store
store = open_store(sys.argv[1])
print("ready", flush=True)
sys.stdin.readline()
print(sum(store.create_json("x", f"lease-{number}.json", {"owner": sys.argv[2]}) for number in range(20)))
"""


def test_one_of_two_creates(url):
    """Two processes create the same documents in the same moment: each goes to exactly one of them."""
    command = [sys.executable, "-c", CREATES, url]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    both = [subprocess.Popen([*command, who], **pipes) for who in "ab"]
    assert [process.stdout.readline() for process in both] == ["ready\n", "ready\n"]
    for process in both:
        process.stdin.write("\n")
        process.stdin.flush()
    won = [int(process.communicate()[0]) for process in both]
    assert sum(won) == 20
    store = open_store(url)
    owners = [store.read_json("x", f"lease-{number}.json")["owner"] for number in range(20)]
    assert [owners.count(who) for who in "ab"] == won


def test_killed_between_copy_and_removal(remote, plan, monkeypatch, caplog):
    """A bad part that was copied but not removed is quarantined once more; what is computed then stays."""
    fill(remote, plan)
    remote.files.write(part_name(plan, 1), b"damaged")
    survey = remote.survey(plan)
    with monkeypatch.context() as patch:
        patch.setattr(object_store.ObjectStore, "remove", lambda self, path: os.strerror(0))
        assert remote.quarantine(plan, survey.bad) == ["part-000001.parquet.bad"]
    survey = remote.survey(plan)
    assert (survey.missing, list(survey.bad)) == ([1], [1])
    assert remote.quarantine(plan, survey.bad) == ["part-000001.parquet.bad-2"]
    fill(remote, plan, [1])
    assert remote.survey(plan).bad == {}
    assert len(remote.table()) == 25


@pytest.mark.slow
def test_listing_is_never_old(remote, plan):
    """What another process writes is seen at once."""
    assert remote.survey(plan).missing == [0, 1, 2]
    script = "import sys; from tests.campaign.store.files.test_s3 import write_apart; write_apart(*sys.argv[1:])"
    subprocess.run([sys.executable, "-c", script, remote.url, plan.campaign_id, plan.row_build], check=True)
    assert remote.survey(plan).missing == [0, 2]
    assert remote.read_part(plan, 1).num_rows == 10


def write_apart(url, campaign_id, build):
    """Compute batch 1; in a process of its own."""
    run_batch(CampaignAddress(url, campaign_id, build, fake_engine.simulate), BatchRequest(1))


def test_no_such_bucket(url):
    """A bucket that is not there is one message."""
    missing = Files("s3://no-such-bucket/runs")
    with pytest.raises(SpecError, match="s3://no-such-bucket/runs"):
        missing.check_writable()
    with pytest.raises(StoreError, match="a cannot be written"):
        missing.write("a", b"x")


def test_no_credentials(url, monkeypatch):
    """Without credentials there is one message too."""
    for key in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(key)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    s3fs.S3FileSystem.clear_instance_cache()
    with pytest.raises(StoreError, match=r"(?i)credentials"):
        Files(url, HASTY).write("a", b"x")
