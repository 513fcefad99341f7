"""``clearcap coordinate`` as a service, with the engine itself on a small mechanism, killed while it drives."""

import json
import random
import subprocess
import sys
import time
import uuid

import pytest

from campaign.spec.load import load_campaign
from campaign.store import open_store
from engine import simulate, warm_up
from tests.campaign.driving import computed
from tests.campaign.storms.checks import bits
from tests.campaign.storms.cluster import DASK, start_cluster, strike
from tests.campaign.storms.supervisor import Supervisor, those_left
from tests.clearcap.cli.test_verbs import SLOPE
from tests.until import until

pytestmark = [pytest.mark.slow, pytest.mark.processes, pytest.mark.bits]

SAMPLES = 300


def test_service_in_a_storm(tmp_path):
    """Campaigns queued before and while it serves are driven to their reports, whatever is killed; the same bits."""
    warm_up()  # compiling may take longer than is waited for rows
    chance = random.Random(5)
    for name in ("before", "meanwhile"):
        text = SLOPE.replace('"slope"', f'"{name}"').replace("samples = 12", f"samples = {SAMPLES}")
        (tmp_path / f"{name}.toml").write_text(text)
    store = open_store(str(tmp_path / "runs"))
    with Supervisor(tmp_path, str(uuid.uuid4()), **DASK) as supervisor:

        def clearcap(*words):
            command = [sys.executable, "-m", "clearcap", *words, "--store", store.url, "--json"]
            done = subprocess.run(command, env=supervisor.environment, check=True, capture_output=True)
            return json.loads(done.stdout)

        first = clearcap("submit", str(tmp_path / "before.toml"), "--batch-size", "5", "--queue-only")
        assert first["driver"] == "none"
        address = start_cluster(supervisor, tmp_path)
        supervisor.add("coordinator", "clearcap", "coordinate", "--store", store.url, "--scheduler", address)
        until(lambda: _rows(store, first) > 20, lambda: supervisor.said("coordinator"))
        second = clearcap("submit", str(tmp_path / "meanwhile.toml"), "--batch-size", "5", "--scheduler", address)
        assert second["driver"] in ("service", "coordinator")
        for kind in ("coordinator", "worker", "scheduler", "coordinator"):
            strike(supervisor, kind, chance)
            time.sleep(chance.uniform(0.5, 3.0))
        for submitted in (first, second):
            report = tmp_path / "runs" / submitted["campaign"] / "report" / "report.html"
            until(report.exists, lambda: supervisor.said("coordinator"))
            assert clearcap("status", submitted["campaign"])["left"] == 0
    assert those_left(supervisor.mark) == []
    for submitted, name in ((first, "before"), (second, "meanwhile")):
        plan = store.plan(submitted["campaign"])
        quiet = computed(tmp_path / f"quiet-{name}", load_campaign(str(tmp_path / f"{name}.toml")), 100, simulate)
        assert bits(store, plan).equals(bits(*quiet))
        assert store.read_json(plan.campaign_id, "lease.json") is None


def _rows(store, submitted):
    return store.survey(store.plan(submitted["campaign"])).rows
