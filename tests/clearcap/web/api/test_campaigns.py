"""The list of campaigns and what is done to one, by role."""

from dataclasses import replace

import pytest

from campaign.coordinator.state import state_of, write_state
from campaign.plan import make_plan
from clearcap.web.index import CampaignEntry, Weakest
from clearcap.web.operations.campaigns import ListQuestion, listed
from tests.clearcap.web.conftest import serving
from tests.each import each

API = "/api/v1/campaigns"


@pytest.fixture
def settings(settings, store):
    return replace(settings, store=store.url)


@pytest.fixture
def at(plan):
    return f"{API}/{plan.campaign_id}"


def test_list(client, as_user, plan):
    answer = client.get(API, headers=as_user("viewer"))
    assert answer.status_code == 200
    document = answer.json()
    assert (document["total"], document["next"]) == (1, None)
    assert document["campaigns"][0]["campaign"] == plan.campaign_id
    again = client.get(API, headers={**as_user("viewer"), "If-None-Match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")


def _entries(n=5):
    entries = [
        CampaignEntry(
            campaign=f"c-{i}", title=f"Latch {i}", state="completed" if i % 2 else "running", owner="eva" if i else "",
            tags=["a", "b"][: i % 3], archived=i == 4, weakest=Weakest(response="F", cpk=1.0 - i) if i else None,
        )
        for i in range(n)
    ]  # fmt: skip
    return [(entry, entry.model_dump_json().encode()) for entry in entries]


@each(
    ("question", "ids"),
    [
        ({}, [0, 1, 2, 3]),
        ({"archived": True}, [0, 1, 2, 3, 4]),
        ({"search": "LATCH 3"}, [3]),
        ({"search": "c-1 eva"}, [1]),
        ({"owner": "eva"}, [1, 2, 3]),
        ({"owner": ""}, [0]),
        ({"state": "running"}, [0, 2]),
        ({"tag": ["a", "b"]}, [2]),
        ({"sort": "cpk"}, [3, 2, 1, 0]),  # without one last
    ],
)
def test_question(question, ids):
    assert [entry.campaign for entry, _ in listed(_entries(), ListQuestion(**question))] == [f"c-{i}" for i in ids]


def test_unknown_state_is_refused(client, as_user):
    """It would find nothing, which reads as if there were none; what a form sends empty stands for all."""
    headers = as_user("viewer")
    answer = client.get(API, params={"state": "done"}, headers=headers)
    assert (answer.status_code, "completed" in answer.text) == (422, True)
    assert client.get(API, params={"state": ""}, headers=headers).json()["total"] == 1


@pytest.fixture
def two_more(store, campaign):
    """Add two campaigns to the store."""
    for samples in (30, 35):
        spec = campaign.spec.model_copy(update={"samples": samples})
        store.create_plan(make_plan(replace(campaign, spec=spec), 10))


def test_pages_of_the_list(two_more, client, as_user):
    headers, seen, cursor = as_user("viewer"), [], ""
    while cursor is not None:
        document = client.get(API, params={"limit": 2, "cursor": cursor}, headers=headers).json()
        seen += [entry["campaign"] for entry in document["campaigns"]]
        cursor = document["next"]
    assert len(seen) == len(set(seen)) == document["total"] == 3


@pytest.mark.parametrize("cursor", ["1", "!", "W10", "WyJ0aXRsZSIsMC4wLCIiLCJkZW1vIl0", "x" * 2001])
def test_a_wrong_cursor_is_refused(client, as_user, cursor):
    """One that is none, and one of a list in another order."""
    answer = client.get(API, params={"cursor": cursor}, headers=as_user("viewer"))
    assert (answer.status_code, "cursor" in answer.json()["detail"]) == (422, True)
    params = {"cursor": "WyJ0aXRsZSIsMC4wLCIiLCJkZW1vIl0", "sort": "title"}
    assert client.get(API, params=params, headers=as_user("viewer")).status_code == 200


def test_status(client, as_user, at):
    document = client.get(at, headers=as_user("viewer")).json()
    assert (document["state"], document["samples"], document["done"]) == ("planned", 25, 0)


def test_unknown_campaign(client, as_user):
    headers = as_user("viewer")
    for path in ("", "/events", "/campaign.toml", "/reports", "/reports/own/report.html"):
        answer = client.get(f"{API}/none-0{path}", headers=headers)
        assert (answer.status_code, answer.json()["detail"]) == (404, "no campaign none-0 in the store")
    assert client.get(f"{API}/service", headers=headers).status_code == 404


@pytest.mark.parametrize("name", ["..%2f..%2fetc%2fpasswd", "%00", ".hidden", "a" * 200, "a/b/../c"])
def test_odd_names_are_refused(client, as_user, at, name):
    headers = as_user("viewer")
    assert client.get(f"{API}/{name}", headers=headers).status_code in (404, 422)
    assert client.get(f"{at}/reports/own/{name}", headers=headers).status_code in (404, 422)


def test_campaign_file(client, as_user, at, store, plan):
    answer = client.get(f"{at}/campaign.toml", headers=as_user("viewer"))
    assert answer.content == store.files.read(f"{plan.campaign_id}/campaign.toml")


def test_campaign_whose_file_was_removed(client, as_user, at, store, plan):
    """A refusal says so, and no bug; it can be listed, and its file asked for when it is back."""
    content = store.files.read(f"{plan.campaign_id}/campaign.toml")
    store.files.remove(f"{plan.campaign_id}/campaign.toml")
    answer = client.get(f"{at}/campaign.toml", headers=as_user("viewer"))
    assert (answer.status_code, "restore it" in answer.json()["detail"]) == (404, True)
    for path in ("", "/status", "/signoffs/content"):
        assert client.get(f"{at}{path}", headers=as_user("approver")).status_code in (200, 409, 422)
    store.files.write(f"{plan.campaign_id}/campaign.toml", content)
    assert client.get(f"{at}/campaign.toml", headers=as_user("viewer")).content == content


def test_report_file_cannot_run_scripts(client, as_user, at, store, plan):
    store.files.write(f"{plan.campaign_id}/report/report.html", b"<script>alert(1)</script>")
    headers = as_user("viewer")
    listed = client.get(f"{at}/reports", headers=headers).json()
    assert listed == {"files": ["report.html"], "comparisons": {}, "pools": {}}
    answer = client.get(f"{at}/reports/own/report.html", headers=headers)
    assert answer.headers["content-security-policy"].startswith("sandbox allow-popups; default-src 'none';")
    assert client.get(f"{at}/reports/own/other.html", headers=headers).status_code == 404


def test_events_of_a_campaign_that_is_over(client, as_user, at, store, plan):
    write_state(store, plan.campaign_id, "cancelled")
    answer = client.get(f"{at}/events", headers=as_user("viewer"))
    assert answer.headers["content-type"].startswith("text/event-stream")
    assert '"state":"cancelled"' in answer.text
    assert answer.text.endswith("event: end\ndata: {}\n\n")


def test_cancel_and_resume(client, as_user, at, store, plan):
    write_state(store, plan.campaign_id, "queued")
    answer = client.post(f"{at}/cancel", headers=as_user("admin"))
    assert answer.json()["before"] == "queued"
    assert state_of(store, plan.campaign_id)["state"] == "cancelled"
    assert client.post(f"{at}/resume", headers=as_user("admin")).json()["note"] == "queued"
    assert state_of(store, plan.campaign_id)["state"] == "queued"


def test_labels(client, as_user, at):
    headers, wanted = as_user("admin"), {"owner": "viewer", "add_tags": ["a"], "version": 0}
    entry = client.patch(f"{at}/labels", json=wanted, headers=headers).json()
    assert (entry["owner"], entry["tags"], entry["labels_version"]) == ("viewer", ["a"], 1)
    answer = client.patch(f"{at}/labels", json={"note": "n", "version": 0}, headers=headers)
    assert answer.status_code == 409
    assert "are now version 1" in answer.json()["detail"]
    assert client.patch(f"{at}/labels", json={"add_tags": ["a b"]}, headers=headers).status_code == 422
    assert client.patch(f"{at}/labels", json={"owners": "eva"}, headers=headers).status_code == 422


def test_delete(client, as_user, at, store, plan):
    for role, confirm, status in [
        ("engineer", plan.campaign_id, 403),  # it is another's
        ("admin", "", 422),
        ("admin", plan.campaign_id, 204),
        ("admin", plan.campaign_id, 404),
    ]:
        answer = client.request("DELETE", at, headers={**as_user(role), "X-Confirm": confirm})
        assert answer.status_code == status
    assert store.campaigns() == []


WRITES = [("POST", "/cancel"), ("POST", "/resume"), ("PATCH", "/labels"), ("DELETE", "")]


@pytest.mark.parametrize(("method", "path"), WRITES)
def test_writes_are_refused_by_role_and_audited(client, service, as_user, browse, at, plan, method, path):
    body = {"json": {"note": "x"}} if path == "/labels" else {}
    assert client.request(method, at + path, **body).status_code == 401
    assert client.request(method, at + path, headers=as_user("viewer"), **body).status_code == 403
    entry = service.audit.newest()[0]
    assert (entry.who, entry.how, entry.object, entry.status) == ("viewer", "token", plan.campaign_id, 403)
    headers = browse("engineer")
    for wrong in ({"Origin": "https://evil.example"}, {"Sec-Fetch-Site": "cross-site"}, {"x-csrf-token": "x"}):
        assert client.request(method, at + path, headers={**headers, **wrong}, **body).status_code == 403
    assert service.audit.first_fault() is None


def test_share_shows_one_campaign_and_writes_nothing(client, service, at, plan):
    _, secret = service.tokens.share(plan.campaign_id, "eva", "", 60.0)
    headers = {"Authorization": f"Bearer {secret}"}
    assert client.get(at, headers=headers).status_code == 200
    assert client.get(API, headers=headers).status_code == 403
    assert client.post(f"{at}/cancel", headers=headers).status_code == 403
    _, other = service.tokens.share("another-1", "eva", "", 60.0)
    assert client.get(at, headers={"Authorization": f"Bearer {other}"}).status_code == 404


def test_streams_of_a_user_are_bounded(settings, plan):
    few = replace(settings, limits=replace(settings.limits, streams=0))
    with serving(few) as (service, client):
        _, secret = service.tokens.add("viewer", "test", service.users.get("viewer").role, 60.0)
        answer = client.get(f"{API}/{plan.campaign_id}/events", headers={"Authorization": f"Bearer {secret}"})
        assert (answer.status_code, answer.headers["retry-after"]) == (429, "5")


@pytest.mark.parametrize(
    "path", ["/campaigns", "/campaigns?search=demo&sort=cpk", "/campaigns/{id}", "/campaigns/{id}/report"]
)
def test_pages(client, browse, plan, path):
    browse("engineer")
    answer = client.get(path.format(id=plan.campaign_id), headers={"Accept": "text/html"})
    assert answer.status_code == 200
    assert plan.campaign_id in answer.text


def test_the_filter_of_the_page_shows_all_that_fit(client, browse, plan):
    """A browser sends what was not chosen too, as an empty text."""
    browse("viewer")
    sent = "state=&owner=&tag=&sort=newest"
    assert "1 campaign<" in client.get(f"/campaigns?search=demo&{sent}").text
    assert "0 campaigns<" in client.get(f"/campaigns?search=other&{sent}").text
    assert "0 campaigns<" in client.get("/campaigns?search=&state=failed&owner=&tag=").text


def test_page_without_login_leads_to_it(client, plan):
    answer = client.get(f"/campaigns/{plan.campaign_id}?x=1", headers={"Accept": "text/html"})
    assert (answer.status_code, answer.headers["location"]) == (
        303,
        f"/login?next=%2Fcampaigns%2F{plan.campaign_id}%3Fx%3D1",
    )
