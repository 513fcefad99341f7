"""An index that knows nothing yet: who asks hears at once of the campaigns that were read, and how many are not."""

import asyncio
import json
from dataclasses import replace
from types import SimpleNamespace

import pytest
import s3fs

from campaign.coordinator.state import write_state
from campaign.errors import UnreachableError
from campaign.plan import make_plan
from campaign.store import Store
from campaign.store.labels import LabelChange, change_labels
from campaign.store.layout import SUBMISSION
from campaign.store.store import change_tokens
from clearcap.client import remote_server
from clearcap.client.remote_server import RemoteServer
from clearcap.web import index as indexing
from clearcap.web.access import Role
from clearcap.web.index import REPORT_DOCUMENT, CampaignIndex, Weakest, entry_of
from clearcap.web.watcher import Watcher
from tests.clearcap.web.conftest import read_all, serving
from tests.clearcap.web.running import until_true

COUNT = 7
_RESPONSES = [("a", 1.5, [1.4, 1.6]), ("b", 1.1, [1.0, 1.2]), ("c", None, None), ("d", 1.2, [None, 1.25])]
REPORT = json.dumps(
    {
        "headline": "capable",
        "thresholds": {"capable": 1.33, "other": 1},
        "responses": [
            {
                "spec": {"name": name, "unit": "mm"},
                "capability": {"cpk": cpk, "cpk_interval": interval},
                "fits": [1] * 99,
            }
            for name, cpk, interval in _RESPONSES
        ],
        "product": {"with_failures": {"share": 0.98}, "counted": {"share": 0.99}},
    }
).encode()


@pytest.fixture
def full_store(store, campaign):
    """Return a store of seven campaigns, of which an index reads two at once."""
    for samples in range(30, 30 + COUNT - 1):
        spec = campaign.spec.model_copy(update={"samples": samples})
        store.create_plan(make_plan(replace(campaign, spec=spec), 10))
    return store


@pytest.fixture
def index(tmp_path, monkeypatch):
    monkeypatch.setattr(indexing, "AT_ONCE", 2)
    made = CampaignIndex(tmp_path / "index.sqlite")
    yield made
    made.close()


def _known(index):
    return {entry.campaign for entry, _ in index.entries()}


def test_first_look_reads_some_and_says_how_many_are_left(full_store, index):
    watcher = Watcher(full_store, index)
    asyncio.run(watcher.list_campaigns())
    assert (len(_known(index)), index.unread) == (2, COUNT - 2)
    asyncio.run(watcher.list_all())
    assert (_known(index), index.unread) == (set(full_store.campaigns()), 0)


def test_the_reader_goes_on_by_itself(full_store, index):
    """It reads all, and each campaign once."""

    async def look():
        watcher = Watcher(full_store, index)
        looking = asyncio.create_task(watcher.run())
        await until_true(lambda: len(_known(index)) == COUNT, "all campaigns")
        looking.cancel()

    asyncio.run(look())
    assert index.unread == 0


def test_what_is_changed_here_is_read_before_what_waits(full_store, index):
    last = sorted(full_store.campaigns())[-1]
    watcher = Watcher(full_store, index)
    asyncio.run(watcher.list_campaigns(last))
    assert last in _known(index)
    assert index.unread == COUNT - 3
    change_labels(full_store, last, LabelChange(owner="eva"))
    asyncio.run(watcher.list_campaigns(last))
    assert index.entry(last).owner == "eva"
    assert index.unread == COUNT - 3, "only the changed one was read"


def test_a_campaign_that_went_while_it_waited_is_not_waited_for(full_store, index):
    last = sorted(full_store.campaigns())[-1]
    index.look(change_tokens(full_store))
    index.forget(last)
    assert index.unread == COUNT - 1


def test_a_bug_in_one_campaign_hides_no_other(full_store, index, monkeypatch, caplog):
    """It is in the log, and the list names the campaign as broken."""
    bad = sorted(full_store.campaigns())[0]
    header = Store.plan_header
    monkeypatch.setattr(Store, "plan_header", lambda s, c: header(s, c) if c != bad else 1 // 0)
    read_all(index, full_store)
    assert _known(index) == set(full_store.campaigns())
    assert index.entry(bad).state == "broken"
    assert "ZeroDivisionError" in index.entry(bad).message
    assert f"campaign {bad} cannot be listed" in caplog.text


@pytest.fixture
def cold(settings, full_store, monkeypatch):
    """Return a service that reads two campaigns when it is asked, and no more; a client, and headers of a viewer."""
    monkeypatch.setattr(indexing, "AT_ONCE", 2)

    async def rest(_):
        await asyncio.Event().wait()

    monkeypatch.setattr(Watcher, "run", rest)
    with serving(replace(settings, store=full_store.url)) as (service, client):
        _, secret = service.tokens.add("viewer", "test", Role.VIEWER, 3600.0)
        yield service, client, {"Authorization": f"Bearer {secret}"}


def test_api_says_how_many_campaigns_are_not_listed_yet(cold):
    service, client, headers = cold
    first = client.get("/api/v1/campaigns", headers=headers)
    assert (first.json()["total"], first.json()["unread"]) == (2, COUNT - 2)
    service.watcher.index.read_some(service.store)
    again = client.get("/api/v1/campaigns", headers={**headers, "If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.json()["total"], again.json()["unread"]) == (200, 4, COUNT - 4)


def test_page_says_so_and_comes_again_soon(cold):
    service, client, headers = cold
    text = " ".join(client.get("/campaigns", headers=headers).text.split())
    assert "2 campaigns so far; 5 of the store are still to be read" in text
    assert 'hx-trigger="every 1s"' in text
    while service.watcher.index.is_behind:
        service.watcher.index.read_some(service.store)
    text = " ".join(client.get("/campaigns", headers=headers).text.split())
    assert "7 campaigns</p>" in text
    assert "still to be read" not in text
    assert 'hx-trigger="every 5s"' in text


def test_nothing_found_so_far_is_not_an_empty_store(cold):
    """Only when all is read does the page say that no campaign fits."""
    service, client, headers = cold
    assert "No campaign matches" not in client.get("/campaigns?state=failed", headers=headers).text
    while service.watcher.index.is_behind:
        service.watcher.index.read_some(service.store)
    assert "No campaign matches" in client.get("/campaigns?state=failed", headers=headers).text


def test_quota_counts_campaigns_that_are_not_listed_yet(cold):
    """Whoever submits has all of his unfinished campaigns counted."""
    service, client, _ = cold
    for campaign in service.store.campaigns():
        write_state(service.store, campaign, "queued")
        service.store.write_json(campaign, SUBMISSION, {"user": "engineer", "time": 1.8e9})
    limits = replace(service.settings.limits, running=COUNT)
    service.settings = replace(service.settings, limits=limits)
    _, secret = service.tokens.add("engineer", "test", Role.ENGINEER, 3600.0)
    answer = client.post(
        "/api/v1/campaigns", json={"text": "x"}, headers={"Authorization": f"Bearer {secret}", "Idempotency-Key": "a"}
    )
    assert answer.status_code == 429
    assert f"{COUNT} queued" in answer.json()["detail"]


class Listing:
    """A connection to a server that has so many campaigns left to read at each question."""

    address = "http://127.0.0.1:1"

    def __init__(self, *unread):
        self.unread, self.asked = list(unread), []

    def get(self, path, params):
        """Answer."""
        self.asked.append(params["cursor"])
        left = self.unread.pop(0) if len(self.unread) > 1 else self.unread[0]
        campaigns = [{"campaign": f"after {params['cursor']}"}] if not left else []
        document = {"campaigns": campaigns, "next": None if params["cursor"] else "500", "unread": left}
        return SimpleNamespace(json=lambda: document)


def test_a_program_gets_all_campaigns(monkeypatch):
    """It waits until the server has read them, also if that begins anew between two pages."""
    monkeypatch.setattr(remote_server.time, "sleep", lambda _: None)
    server = Listing(900, 450, 0, 3, 0)
    assert [each["campaign"] for each in RemoteServer(server).campaigns()] == ["after ", "after 500"]
    assert server.asked == ["", "", "", "500", "500"]


def test_a_program_does_not_wait_for_ever(monkeypatch):
    now = iter(range(0, 10_000, 20))
    monkeypatch.setattr(remote_server, "time", SimpleNamespace(sleep=lambda _: None, monotonic=lambda: next(now)))
    with pytest.raises(UnreachableError, match=r"\b7 campaigns"):
        list(RemoteServer(Listing(9, 8, 7)).campaigns())


def test_few_requests_a_campaign(full_store, monkeypatch):
    """On S3 one listing, and one request for each file that the list knows something from."""
    campaign = sorted(full_store.campaigns())[0]
    write_state(full_store, campaign, "completed")
    full_store.write_json(campaign, SUBMISSION, {"user": "eva", "time": 1.8e9})
    full_store.files.write(f"{campaign}/{REPORT_DOCUMENT}", REPORT)
    asked = []
    call = s3fs.S3FileSystem._call_s3

    async def counted(self, method, *arguments, **more):
        asked.append(method)
        return await call(self, method, *arguments, **more)

    monkeypatch.setattr(s3fs.S3FileSystem, "_call_s3", counted)
    entry = entry_of(full_store, campaign)
    assert (entry.state, entry.submitted_by, entry.headline) == ("incomplete", "eva", "capable")
    requests = ["get_object"] * 4 + ["list_objects_v2"]  # plan, state, submission, report
    assert sorted(asked) == ([] if full_store.files.local else requests)


def test_report_tells_headline_weakest_and_share(full_store):
    """Of a report that has much more."""
    campaign = sorted(full_store.campaigns())[0]
    write_state(full_store, campaign, "cancelled")
    full_store.files.write(f"{campaign}/{REPORT_DOCUMENT}", REPORT)
    entry = entry_of(full_store, campaign)
    assert entry.weakest == Weakest(response="b", cpk=1.1, interval=(1.0, 1.2))
    assert [each.response for each in entry.below_target] == ["b"]
    assert (entry.headline, entry.share_ok, entry.has_report, entry.message) == ("capable", 0.98, True, "")


@pytest.mark.parametrize(
    ("verdicts", "worst"),
    [
        ([("capable", True), ("no limits", None)], "capable"),
        ([("capable", True), ("capable", False)], "capable, not certain"),
        ([("marginal", True), ("not capable", True), ("capable", True)], "not capable"),
        ([("no verdict", None), ("not capable", True)], "no verdict"),
        ([("no limits", None)], ""),
    ],
)
def test_list_has_the_worst_verdict(full_store, verdicts, worst):
    """One that is not certain is worse than the same that is; without a verdict too few samples may be ok."""
    campaign = sorted(full_store.campaigns())[0]
    write_state(full_store, campaign, "cancelled")
    report = json.loads(REPORT)
    response = report["responses"][0]
    report["responses"] = [response | {"verdict": word, "certain": certain} for word, certain in verdicts]
    full_store.files.write(f"{campaign}/{REPORT_DOCUMENT}", json.dumps(report).encode())
    assert entry_of(full_store, campaign).verdict == worst


@pytest.mark.parametrize("report", [b"{", b"[]", b'{"headline": 1}', REPORT.replace(b"1.1", b'"many"'), b"\xff"])
def test_report_that_is_not_one(full_store, report):
    """The campaign is listed, and says that its report is to be written again."""
    campaign = sorted(full_store.campaigns())[0]
    write_state(full_store, campaign, "cancelled")
    full_store.files.write(f"{campaign}/{REPORT_DOCUMENT}", report)
    entry = entry_of(full_store, campaign)
    assert (entry.state, entry.has_report, entry.weakest) == ("cancelled", True, None)
    assert "write it again" in entry.message
