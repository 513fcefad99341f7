"""``clearcap report``: what cannot be written ends in an exit status that a script sees."""

import json

import pytest

from tests.campaign.commands import clearcap_here


def test_a_pdf_without_weasyprint_is_refused(store, plan, capsys, monkeypatch):
    """Not a line and status 0, after which a script looks for a file that is not there."""
    monkeypatch.setattr("reporting.write.find_spec", lambda name: None)
    status, _, said = clearcap_here(capsys, monkeypatch, "report", plan.campaign_id, "--store", store.url, "--pdf")
    assert status == 1
    assert "pip install 'clearcap[pdf]'" in said
    assert not store.files.exists(f"{plan.campaign_id}/report/report.html")


def test_a_summary_is_written_beside_the_report(store, plan, capsys, monkeypatch):
    """Only when it is asked for; with --pdf on paper too."""
    words = ("report", plan.campaign_id, "--store", store.url, "--no-excel", "--json")
    kinds = {}
    for options in ((), ("--summary",)):
        status, printed, _ = clearcap_here(capsys, monkeypatch, *words, *options)
        assert status == 0
        kinds[options] = json.loads(printed)["report"]
    assert set(kinds["--summary",]) - set(kinds[()]) == {"summary"}
    assert kinds["--summary",]["summary"].endswith("summary.html")


@pytest.mark.slow
def test_a_summary_on_paper(store, plan, capsys, monkeypatch):
    """Both documents as PDF."""
    pytest.importorskip("weasyprint")
    words = ("report", plan.campaign_id, "--store", store.url, "--no-excel", "--summary", "--pdf")
    assert clearcap_here(capsys, monkeypatch, *words)[0] == 0
    for name in ("report.pdf", "summary.pdf"):
        assert store.files.read(f"{plan.campaign_id}/report/{name}").startswith(b"%PDF")
