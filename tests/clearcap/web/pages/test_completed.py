"""The pages of a campaign between its last row and its report: nothing to cancel, what happens now, and it comes."""

from dataclasses import replace

import pytest

from campaign.coordinator.state import write_state
from campaign.coordinator.submit import submit
from campaign.store.layout import DECISION

REFRESH = '<meta http-equiv="refresh" content="10">'


@pytest.mark.parametrize("is_late", [False, True])
def test_report_is_on_its_way(client, service, reported, browse, monkeypatch, is_late):
    """Later, when none has come, the page stands still and says how to write it."""
    files = service.store.files
    for name in files.names(f"{reported}/report"):
        files.remove(f"{reported}/report/{name}")
    write_state(service.store, reported, "completed")
    client.portal.call(service.watcher.list_all)  # the pages show what the server has seen
    if is_late:
        monkeypatch.setattr("clearcap.web.pages.campaigns.REPORT_WITHIN", -1.0)
    browse("admin")
    progress, report = (client.get(f"/campaigns/{reported}{page}").text for page in ("", "/report"))
    assert (REFRESH in progress, REFRESH in report) == (not is_late, not is_late)
    assert ("report is being written" in progress) == ("report is being written" in report) == (not is_late)
    assert ("write it below" in report) == is_late
    assert "Write the report</button>" in report
    assert "Stop (finished rows are kept)" not in progress


def test_runs_that_decide_are_said_to_come_first(client, service, reported, browse, campaign, monkeypatch):
    """Until they are computed there is no report, however long that takes; the list says what they are for."""
    files = service.store.files
    for name in files.names(f"{reported}/report"):
        files.remove(f"{reported}/report/{name}")
    write_state(service.store, reported, "completed")
    other = replace(campaign, spec=campaign.spec.model_copy(update={"seed": 99, "samples": 70}))
    aimed = submit(service.store, other, tries_runs=False).campaign_id
    write_state(service.store, aimed, "queued")
    service.store.write_json(reported, DECISION, {"stages": [{"campaign": aimed, "responses": ["FC-1"]}]})
    client.portal.call(service.watcher.list_all)
    monkeypatch.setattr("clearcap.web.pages.campaigns.REPORT_WITHIN", -1.0)
    browse("admin")
    for page in ("", "/report"):
        text = client.get(f"/campaigns/{reported}{page}").text
        assert f"<code>{aimed}</code>, 0 of 70 runs near the limits, decides them; then the report is written." in text
    assert f"further runs, which decide {reported}<" in client.get("/campaigns").text
    assert f'which decide the verdicts of <a href="/campaigns/{reported}">' in client.get(f"/campaigns/{aimed}").text
    assert "which decide" not in client.get(f"/campaigns/{reported}").text


def test_only_what_is_open_is_cancelled(client, service, reported, browse):
    browse("admin")
    for state, may_cancel in (("queued", True), ("completed", False), ("failed", False), ("cancelled", False)):
        write_state(service.store, reported, state)
        service.watcher.hurry(reported)
        client.get("/campaigns")
        assert ("Stop (finished rows are kept)" in client.get(f"/campaigns/{reported}").text) == may_cancel, state
