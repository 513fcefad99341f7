"""The page that compares two campaigns, and the report of it."""

import pytest

pytestmark = pytest.mark.processes


def test_compare(visit, submit, explored):
    """It has the numbers of the call; an engineer writes the report, which the page then names."""
    home = f"/campaigns/{explored[1]}/compare"
    assert f'<option value="{explored[0]}">' in visit(home, "viewer").text
    text = visit(f"{home}?with={explored[0]}", "viewer").text
    assert "FC-1 [N]" in text
    assert "Write the report" not in text
    answer = submit(home, **{"with": explored[0]})
    assert (answer.status_code, answer.headers["location"]) == (303, f"{home}?with={explored[0]}")
    assert f"/reports/against/{explored[0]}/report.html" in visit(answer.headers["location"]).text
    assert submit(home, "viewer", **{"with": explored[0]}).status_code == 403


def test_wrong_comparisons(visit, explored):
    home = f"/campaigns/{explored[1]}/compare"
    assert "is the campaign itself" in visit(f"{home}?with={explored[1]}").text
    visit(f"{home}?with=none", status=404)
    visit(f"{home}?with=../x", status=422)


def test_report_is_written_again(visit, submit, explored):
    home = f"/campaigns/{explored[1]}/report"
    assert submit(home).headers["location"] == home
    assert "report.html" in visit(home).text
    assert "Write the report again" not in visit(home, "viewer").text
    assert submit(home, "viewer").status_code == 403
