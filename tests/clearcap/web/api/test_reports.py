"""Reports that are written again, and comparisons of campaigns."""

import os

import pytest

from tests.clearcap.web.conftest import only_in_a_folder


@pytest.mark.processes
def test_report_and_comparison_are_written(computing, explored):
    """By engineers; a comparison leaves the campaign's own report as it is."""
    client, headers = computing
    home = f"/api/v1/campaigns/{explored[1]}"
    assert client.post(f"{home}/report", headers=headers("viewer")).status_code == 403
    assert client.post(f"{home}/comparisons/{explored[0]}", headers=headers("viewer")).status_code == 403
    files = client.post(f"{home}/report", headers=headers("engineer")).json()
    assert "report.html" in files["files"]
    own = client.get(f"{home}/reports/own/report.html", headers=headers("viewer")).headers["etag"]
    files = client.post(f"{home}/comparisons/{explored[0]}", headers=headers("engineer")).json()
    assert "report.html" in files["comparisons"][explored[0]]
    assert client.get(f"{home}/reports/own/report.html", headers=headers("viewer")).headers["etag"] == own
    assert client.post(f"{home}/comparisons/{explored[1]}", headers=headers("engineer")).status_code == 422
    assert client.post(f"{home}/comparisons/none", headers=headers("engineer")).status_code == 404


def test_signed_report_is_not_written_again(client, service, reported, as_user, monkeypatch):
    monkeypatch.setattr(service.signing_service, "is_signed", lambda _: True)
    answer = client.post(f"/api/v1/campaigns/{reported}/report", headers=as_user("engineer"))
    assert answer.status_code == 409
    assert "signed" in answer.json()["detail"]


@only_in_a_folder
def test_what_else_lies_in_a_report_is_not_listed(client, settings, reported, as_user):
    """A name that no report has, as one that is no UTF-8, stops neither the list nor the page."""
    folder = os.fsencode(f"{settings.store}/{reported}/report")
    for name in (b"\xff.html", b"a b.html", b"-x"):
        with open(os.path.join(folder, name), "wb"):
            pass
    headers = as_user("engineer")
    files = client.get(f"/api/v1/campaigns/{reported}/reports", headers=headers).json()["files"]
    assert files == ["capability.json", "report.html"]
    assert client.get(f"/campaigns/{reported}/export", headers=headers).status_code == 200
