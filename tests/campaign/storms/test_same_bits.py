"""One hash for a table, however it was computed: workers, batches, encryption, and what was killed meanwhile."""

import hashlib
import random
import uuid

import pytest

from campaign.cluster.cluster import Cluster
from campaign.cluster.tls_certificates import make_certificates
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.submit import submit
from campaign.spec.load import load_campaign
from campaign.store import open_store
from tests.campaign import fake_engine
from tests.campaign.driving import computed
from tests.campaign.storms.checks import bits
from tests.campaign.storms.cluster import DASK, drive, start_cluster, strike
from tests.campaign.storms.supervisor import Supervisor, those_left
from tests.campaign.storms.test_failures import parts
from tests.until import until

pytestmark = [pytest.mark.slow, pytest.mark.processes]


def digest(store, plan):
    """Return a hash over every bit of a table: names, types, units, values, which of them are null."""
    table = bits(store, plan)
    seen = hashlib.sha256(table.schema.to_string(show_field_metadata=True).encode())
    for column in table.columns:
        seen.update(repr([x.hex() if isinstance(x, float) else x for x in column.to_pylist()]).encode())
    return seen.hexdigest()


@pytest.fixture
def asked(campaign_file):
    """Return a campaign of 300 samples."""
    return load_campaign(str(campaign_file), samples=300)


def locally(folder, asked, workers, size):
    store = open_store(str(folder))
    plan = submit(store, asked, size)
    coordinate(store, plan, Cluster(workers=workers), simulate=fake_engine.simulate)
    return digest(store, plan)


def stormy(folder, asked, size, tls=None, strikes=()):
    """Compute with processes under a supervisor, some of them killed."""
    store, chance = open_store(str(folder / "store")), random.Random(size)
    plan = submit(store, asked, size)
    with Supervisor(folder, str(uuid.uuid4()), **DASK) as supervisor:
        address = start_cluster(supervisor, folder, tls=tls)
        drive(supervisor, store, plan, address, 0.02, *(("--tls", tls) if tls else ()))
        for number, kind in enumerate(strikes, 1):
            ready = number * len(plan.batches) // (2 * len(strikes))
            until(lambda ready=ready: len(parts(store, plan)) >= ready, lambda: supervisor.said("coordinator"))
            until(lambda kind=kind: strike(supervisor, kind, chance), lambda: supervisor.said("coordinator"))
        until(lambda: supervisor.finished("coordinator"), lambda: supervisor.said("coordinator"))
    assert those_left(supervisor.mark) == []
    return digest(store, plan)


def test_one_hash(tmp_path, asked):
    """The same bits for 1, 2, 4 workers, batches of 1, 7, 100, in the clear or over TLS, quiet or in a storm."""
    expected = digest(*computed(tmp_path / "quiet", asked, 100))
    other = load_campaign(str(tmp_path / "demo.toml"), samples=300, seed=8)
    assert digest(*computed(tmp_path / "other", other, 100)) != expected
    found = {}
    for workers, size in ((1, 100), (2, 7), (4, 1)):
        found[f"{workers} workers, batches of {size}"] = locally(tmp_path / f"local-{workers}", asked, workers, size)
    certificates = tmp_path / "certificates"
    make_certificates(certificates, 2)
    for name in ("tls", "storm"):
        (tmp_path / name).mkdir()
    found["TLS"] = stormy(tmp_path / "tls", asked, 7, tls=certificates)
    found["storm"] = stormy(tmp_path / "storm", asked, 7, strikes=("worker", "scheduler", "coordinator"))
    assert found == dict.fromkeys(found, expected)
