"""A store that goes away while a server is asked: the server lives, says at once what is wrong, and recovers."""

import threading

import httpx2 as httpx
import pytest

from campaign.coordinator.state import write_state
from campaign.spec.load import load_campaign
from tests.campaign.conftest import SPEC
from tests.campaign.driving import computed
from tests.campaign.store.files.test_s3 import bucket, s3_server
from tests.campaign.switch import Switch
from tests.clearcap.web.running import Served
from tests.until import until

pytestmark = [pytest.mark.slow, pytest.mark.processes]

MANY = 60  # who ask at once: more than a server has threads
WITHIN = 300.0  # s, for an answer; the libraries for S3 alone would wait for more than six minutes


@pytest.fixture(scope="module")
def away(tmp_path_factory):
    """Return a server whose store is on S3, the way to it, a campaign of it, and what asks as an admin."""
    folder = tmp_path_factory.mktemp("away")
    with s3_server() as (_, port), pytest.MonkeyPatch.context() as patch:
        switch = Switch(port)
        address = bucket(patch, switch.port)
        patch.delenv("AWS_MAX_ATTEMPTS")  # as users have it: botocore tries again, too
        (folder / "demo.toml").write_text(SPEC)
        store, plan = computed(address, load_campaign(str(folder / "demo.toml")), 10)
        write_state(store, plan.campaign_id, "completed")
        with Served(folder, "--store", address, "--no-drive") as server:
            headers = server.wait().token()
            with httpx.Client(base_url=server.url, headers=headers, timeout=WITHIN) as client:
                yield server, switch, plan.campaign_id, client


@pytest.mark.parametrize("how", ["refuse", "keep_silent"])
def test_store_away(away, how):
    """What needs the store is answered by 503, which says when to ask again; what does not, as ever."""
    server, switch, campaign, client = away
    home = f"/api/v1/campaigns/{campaign}"
    reading = [f"{home}/samples/3", f"{home}/reports", f"{home}/campaign.toml", f"{home}/status", "/api/v1/mechanisms"]
    before = {path: client.get(path) for path in reading}
    assert {answer.status_code for answer in before.values()} == {200}
    getattr(switch, how)()
    try:
        assert client.get("/readyz").status_code == 503
        _ask_all_at_once(client, reading[0])
        for path in reading:
            answer = client.get(path)
            assert (answer.status_code, answer.headers["content-type"]) == (503, "application/problem+json"), path
            assert int(answer.headers["retry-after"]) > 0
            assert "check that it exists and can be reached" in answer.json()["detail"]
        page = client.get(f"/campaigns/{campaign}", headers={"Accept": "text/html"})
        assert (page.status_code, "can be reached" in page.text) == (503, True)
        assert client.post(f"{home}/cancel").status_code == 503
        listed = client.get("/api/v1/campaigns").json()
        assert [each["campaign"] for each in listed["campaigns"]] == [campaign]
        assert "can be reached" in listed["fault"]
        assert "can be reached" in client.get("/campaigns", headers={"Accept": "text/html"}).text
        assert client.get("/api/v1/users").status_code == 200
        assert client.get("/healthz").status_code == 200
    finally:
        switch.lead()
    until(lambda: client.get("/readyz").status_code == 200, server.said)
    assert {path: client.get(path).content for path in reading} == {path: each.content for path, each in before.items()}
    until(lambda: client.get("/api/v1/campaigns").json()["fault"] == "", server.said)
    assert "Traceback" not in server.log.read_text()


def _ask_all_at_once(client, path):
    """Have many ask; meanwhile the server answers others."""
    statuses = []
    threads = [threading.Thread(target=lambda: statuses.append(client.get(path).status_code)) for _ in range(MANY)]
    for thread in threads:
        thread.start()
    assert client.get("/healthz").status_code == 200
    assert client.get("/api/v1/users").status_code == 200, "it needs a thread"
    for thread in threads:
        thread.join()
    assert set(statuses) == {503}
