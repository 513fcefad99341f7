"""A tenth of the requests to S3 goes wrong, in seven ways: the table is that of a folder, to the bit."""

import json
import os
import secrets
import urllib.request

import pytest
import s3fs

from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from campaign.store.files.retry_policy import RetryPolicy
from tests.campaign import fake_engine
from tests.campaign.conftest import campaign_file  # noqa: F401  # a fixture
from tests.campaign.driving import computed, rows
from tests.campaign.store.files.test_s3 import ACCESS, s3_server

pytestmark = pytest.mark.processes

SEED = int(os.environ.get("CLEARCAP_SECURITY_SEED") or 1)


@pytest.mark.slow
def test_campaign_with_faults(tmp_path, monkeypatch, campaign_file):  # noqa: F811
    """Errors, lost connections and answers, half bodies, delays: no row is lost, doubled or different."""
    print(f"CLEARCAP_SECURITY_SEED={SEED} repeats it")
    campaign = load_campaign(str(campaign_file), samples=60)
    reference = rows(*computed(tmp_path / "folder", campaign, 60))
    with s3_server(percent=10, seed=SEED) as (_, port):
        for key, value in {**ACCESS, "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}"}.items():
            monkeypatch.setenv(key, value)
        s3fs.S3FileSystem.clear_instance_cache()
        make_bucket(name := f"bucket-{secrets.token_hex(4)}")
        monkeypatch.setattr(s3fs.S3FileSystem, "retries", 1)  # so that what is seen to repeat is the store
        store = open_store(f"s3://{name}/runs", RetryPolicy(600.0, 0.05, 1.0))
        plan = submit(store, campaign, 2)
        outcome = coordinate(store, plan, Cluster(workers=2), simulate=fake_engine.simulate)
        assert outcome.survey.missing == []
        assert rows(store, outcome).equals(reference)
        store.compact(plan)
        assert store.table(plan.campaign_id).drop_columns(["wall_s", "attempts"]).equals(reference)
        assert store.survey(plan, verify=True).bad == {}
        assert store.read_json(plan.campaign_id, "lease.json") is None
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/faults-of-the-test") as answer:
            counts = json.load(answer)
        print(counts)
        assert sum(counts.values()) - counts["requests"] > counts["requests"] / 30


def make_bucket(name):
    """Make a bucket, which a store does not do."""
    for _ in range(20):
        try:
            s3fs.S3FileSystem().mkdir(name)
        except FileExistsError:
            return
        except Exception:  # one of the faults
            continue
        return
