"""Shared links over the API: who makes them, what they show, and when they end."""

import pytest

from campaign.coordinator.heartbeat import Heartbeat, WorkerProgress
from campaign.coordinator.lease import hold_lease
from campaign.coordinator.state import write_state
from campaign.store.layout import HEARTBEAT
from campaign.store.store import report_folder


@pytest.fixture
def url(reported, service):
    return f"/api/v1/campaigns/{reported}/shares"


def test_only_engineers_share(client, as_user, url):
    for method, path in (("GET", url), ("POST", url), ("DELETE", f"{url}/1")):
        assert client.request(method, path, json={}).status_code == 401
        assert client.request(method, path, json={}, headers=as_user("viewer")).status_code == 403


def test_link_from_first_to_last(client, service, as_user, reported, url):
    """It shows one campaign, is listed without its secret, and ends with all its sessions."""
    eva = as_user("engineer")
    made = client.post(url, json={"days": 7, "note": "for the review"}, headers=eva).json()
    path = made["link"].partition(":8700")[2]
    secret = path.rpartition("/")[2]
    listed = client.get(url, headers=eva)
    assert (listed.json()["shares"], secret in listed.text) == ([made["share"]], False)
    assert (made["share"]["note"], made["share"]["is_valid"]) == ("for the review", True)
    assert client.get(path).status_code == 200
    assert client.get(f"/api/v1/campaigns/{reported}").status_code == 200
    assert client.get("/api/v1/campaigns").status_code == 403
    assert client.delete(f"{url}/{made['share']['id']}", headers=eva).status_code == 204
    assert client.get(f"/api/v1/campaigns/{reported}").status_code == 401
    assert client.delete(f"{url}/99", headers=eva).status_code == 404
    assert [entry.detail for entry in service.audit.newest(subject=reported)][-1] == "share 1, 7 days"


def test_link_shows_no_comparison_with_another_campaign(client, service, as_user, reported):
    """What was written of both campaigns is read by users: neither its files nor the other's id come by a link."""
    other = "demo-0123456789"
    service.store.files.write(f"{report_folder(reported, other)}/report.html", b"<p>both</p>")
    _, secret = service.tokens.share(reported, "engineer", "", 60.0)
    guest, home = {"Authorization": f"Bearer {secret}"}, f"/api/v1/campaigns/{reported}"
    lists = [f"{home}/reports", f"{home}/status", f"/campaigns/{reported}/report", f"/campaigns/{reported}/export"]
    for path in lists:
        assert other in client.get(path, headers=as_user("viewer")).text
        answer = client.get(path, headers=guest)
        assert (answer.status_code, other in answer.text) == (200, False), path
    file = f"{home}/reports/against/{other}/report.html"
    assert client.get(file, headers=as_user("viewer")).content == b"<p>both</p>"
    assert client.get(file, headers=guest).status_code == 404
    assert client.get(f"{home}/reports/own/report.html", headers=guest).status_code == 200


def test_link_shows_no_machines(client, service, as_user, reported):
    """Users see what each worker does; a guest sees the progress alone."""
    line = WorkerProgress("node1", 77, 6, 2.5, 4990.0)
    beat = Heartbeat(reported, "running", 25, 20, 20, 0, 5, {"ok": 20}, 6.0, 3.0, 4, by_worker=[line])
    _, secret = service.tokens.share(reported, "engineer", "", 60.0)
    with hold_lease(service.store, reported):
        write_state(service.store, reported, "running")
        service.store.write_json(reported, HEARTBEAT, beat.to_json())
        for headers, count in ((as_user("viewer"), 1), ({"Authorization": f"Bearer {secret}"}, 0)):
            found = client.get(f"/api/v1/campaigns/{reported}/status", headers=headers).json()["heartbeat"]
            assert (found["done"], len(found["by_worker"])) == (20, count)


def test_links_come_in_pages(client, as_user, url):
    eva = as_user("engineer")
    for _ in range(3):
        client.post(url, json={}, headers=eva)
    first = client.get(url, params={"limit": 2}, headers=eva).json()
    rest = client.get(url, params={"cursor": first["next"]}, headers=eva).json()
    assert [share["id"] for share in first["shares"] + rest["shares"]] == [3, 2, 1]
    assert rest["next"] is None


@pytest.mark.parametrize("body", [{"days": 0}, {"days": 91}, {"days": "x"}, {"note": "x" * 201}, {"more": 1}])
def test_hostile_links(client, as_user, url, body):
    assert client.post(url, json=body, headers=as_user("engineer")).status_code == 422


def test_unknown_campaign(client, as_user, url):
    answer = client.post("/api/v1/campaigns/nowhere/shares", json={}, headers=as_user("engineer"))
    assert answer.status_code == 404


def test_too_many_links(client, as_user, url, monkeypatch):
    monkeypatch.setattr("clearcap.web.operations.people.MOST_SHARES", 1)
    eva = as_user("engineer")
    assert [client.post(url, json={}, headers=eva).status_code for _ in range(2)] == [201, 409]
