"""``clearcap report``: what cannot be written ends in an exit status that a script sees."""

from tests.campaign.commands import clearcap_here


def test_a_pdf_without_weasyprint_is_refused(store, plan, capsys, monkeypatch):
    """Not a line and status 0, after which a script looks for a file that is not there."""
    monkeypatch.setattr("reporting.write.find_spec", lambda name: None)
    status, _, said = clearcap_here(capsys, monkeypatch, "report", plan.campaign_id, "--store", store.url, "--pdf")
    assert status == 1
    assert "pip install 'clearcap[pdf]'" in said
    assert not store.files.exists(f"{plan.campaign_id}/report/report.html")
