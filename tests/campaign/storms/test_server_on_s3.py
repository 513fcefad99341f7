"""A storm over a server whose store is on S3: what serves and computes is killed, and the way to S3 is cut."""

import random
import signal
import time
import uuid
from contextlib import suppress

import pytest

from campaign.errors import StoreError
from campaign.plan import make_plan
from campaign.spec.load import load_campaign
from campaign.store import open_store
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.campaign.store.files.test_s3 import bucket, s3_server
from tests.campaign.storms.checks import bits
from tests.campaign.storms.cluster import DASK
from tests.campaign.storms.command import CLOCK, SECONDS
from tests.campaign.storms.disturbances import hit
from tests.campaign.storms.modes import MODES, STAND_IN, start_server
from tests.campaign.storms.server_checks import check_accounts, check_visits
from tests.campaign.storms.storm import Storm
from tests.campaign.storms.supervisor import Supervisor, those_left
from tests.campaign.switch import Switch
from tests.clearcap.web.running import until

pytestmark = [pytest.mark.slow, pytest.mark.processes]

BOUND = 1800.0  # s, for whatever may hang
AWAY = 10.0  # s, longer than a server waits for an answer


@pytest.fixture
def switch():
    """Return the way to a server that speaks S3."""
    with s3_server() as (_, port):
        led = Switch(port)
        yield led
        led.refuse()


def test_server_on_s3_in_a_storm(tmp_path, campaign_file, monkeypatch, switch):
    """No row is lost or different, no entry that was answered is missing, nobody is told of a bug."""
    campaign_file.write_text(SPEC.replace("samples = 25", "samples = 300"))
    asked = load_campaign(str(campaign_file))
    quiet = bits(*computed(tmp_path / "quiet", asked, 100))
    store, plan = open_store(bucket(monkeypatch, switch.port)), make_plan(asked, None)
    monkeypatch.delenv("AWS_MAX_ATTEMPTS")  # as users have it: botocore tries again, too
    (tmp_path / "clock").touch()
    environment = {**DASK, SECONDS: "0.05", CLOCK: str(tmp_path / "clock"), "TMPDIR": str(tmp_path)}
    with Supervisor(tmp_path, str(uuid.uuid4()), **environment) as supervisor:
        storm = Storm(random.Random(1), supervisor, tmp_path, store, plan.campaign_id, MODES["server"])
        start_server(storm, campaign_file, STAND_IN)
        try:
            for share, disturb in enumerate(_disturbances(storm, switch), start=1):
                until(lambda share=share: _parts(store, plan) >= share, supervisor.lives[-1].text, BOUND)
                disturb()
            until(lambda: storm.is_over() and storm.visitors.has_seen_the_end, supervisor.lives[-1].text, BOUND)
            check_visits(storm, plan.batches[0][1])
        finally:
            switch.lead()
            storm.visitors.leave()
    assert those_left(supervisor.mark, within=BOUND) == []
    check_accounts(storm)
    assert bits(store, plan).equals(quiet)
    assert store.files.exists(f"{plan.campaign_id}/report/report.html")


def _disturbances(storm, switch):
    """Return what is done, one after the other."""

    def away(begin):
        def cut():
            begin()
            time.sleep(AWAY)
            switch.lead()

        return cut

    def kill(role):
        def strike():
            assert hit(storm, role, signal.SIGKILL), f"there was no {role}"

        return strike

    return [away(switch.keep_silent), kill("server"), away(switch.refuse), kill("coordinator"), kill("worker")]


def _parts(store, plan):
    """Return how many parts there are, of which the way to the store says nothing while it is cut."""
    with suppress(StoreError):
        return len(store.files.hasty.names(f"{plan.campaign_id}/parts"))
    return 0
