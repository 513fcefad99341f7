"""Who made a campaign, and when: the head of the report, and reports that are equal but for their date."""

import getpass
import json
from pathlib import Path

import pytest

from campaign.coordinator.state import write_state
from campaign.errors import SpecError
from campaign.reports.authorship import author, campaign_end, report_date
from campaign.reports.report import report
from campaign.spec.load import load_campaign
from tests.campaign.driving import computed


def test_the_author_is_the_campaigns_else_the_headers_else_who_submitted_it(campaign_file, tmp_path):
    """The nearest to a signature wins."""
    texts = {"": getpass.getuser(), '[header]\nAuthor = "quality lab"\n': "quality lab"}
    plain = campaign_file.read_text()
    for i, (added, expected) in enumerate(texts.items()):
        campaign_file.write_text(plain + added)
        store, plan = computed(tmp_path / str(i), load_campaign(str(campaign_file)), 25)
        assert author(plan, store) == expected
    campaign_file.write_text(plain.replace("samples", 'author = "A. Author <x>"\nsamples'))
    store, plan = computed(tmp_path / "named", load_campaign(str(campaign_file)), 25)
    assert author(plan, store) == "A. Author <x>"
    assert "<dd>A. Author &lt;x&gt;</dd>" in Path(report(store, plan)["html"]).read_text()


@pytest.mark.parametrize("content", [{}, {"user": 7}, {"user": None}])
def test_an_author_that_nobody_knows_is_empty(store, plan, content):
    """A store of an earlier version has no submission; a broken one names nobody."""
    store.write_json(plan.campaign_id, "submission.json", content)
    assert author(plan, store) == ""


@pytest.mark.parametrize("state", [{}, {"state": "running", "since": 0}, {"state": "completed", "since": "x"}])
def test_a_campaign_has_an_end_when_it_is_completed(store, plan, state):
    """Not while it runs, and not if the store does not say when."""
    store.write_json(plan.campaign_id, "state.json", state)
    assert campaign_end(plan, store) == ""
    store.write_json(plan.campaign_id, "state.json", {"state": "completed", "since": 1_763_856_000.5})
    assert campaign_end(plan, store) == "2025-11-23 00:00 UTC"


def test_the_date_of_a_report_can_be_given(monkeypatch):
    """As reproducible builds give it."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert report_date() == "1970-01-01 00:00 UTC"
    for wrong in ("", "-1", "noon", "1e9", "9" * 30):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
        with pytest.raises(SpecError, match="SOURCE_DATE_EPOCH"):
            report_date()


@pytest.mark.slow
def test_two_reports_differ_in_their_date_alone(campaign, tmp_path, monkeypatch):
    """All files are equal bit for bit, but for the one place of the page and of the JSON where the date stands."""
    store, plan = computed(tmp_path, campaign, 25)
    write_state(store, plan.campaign_id, "completed")
    files = []
    for date in ("0", "0", "86400"):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", date)
        files.append({kind: Path(path).read_bytes() for kind, path in report(store, plan).items()})
    first, again, later = files
    assert first == again
    assert {kind for kind in first if first[kind] != later[kind]} == {"html", "json"}
    for kind in ("html", "json"):
        assert first[kind].count(b"1970-01-01 00:00 UTC") == 1
        assert first[kind].replace(b"1970-01-01 00:00", b"1970-01-02 00:00") == later[kind]
    assert json.loads(first["json"])["ended"].endswith("UTC")
