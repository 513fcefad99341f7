"""The pages of samples: the worst first, one sample, and its replay."""

import pytest

from tests.clearcap.web.pages.forms import Page

pytestmark = pytest.mark.processes


def test_worst_samples_and_pages(visit, explored):
    home = f"/campaigns/{explored[1]}/samples"
    text = visit(home, "viewer").text
    assert "400 samples" in text
    assert f'href="{home}?&amp;cursor=50">Next 50' in text
    text = visit(f"{home}?sort=sample&cursor=350").text
    assert f'<a href="{home}/399">399</a>' in text
    assert ">Next" not in text
    assert "0 samples" in visit(f"{home}?status=crashed").text


def test_table_has_variables_and_is_sorted_by_any_column(visit, explored):
    home = f"/campaigns/{explored[1]}/samples"
    text = visit(f"{home}?sort=-J1").text
    assert f'aria-sort="descending"><a href="{home}?sort=J1">J1</a>' in text
    assert f'<a href="{home}?sort=FC-1">FC-1</a>' in text
    assert "allowed: margin, sample, J1" in visit(f"{home}?sort=none").text


def test_ranges_of_a_form(visit, explored):
    """Without scripts by a redirection, with them in the header that replaces the address; the fields keep them."""
    home = f"/campaigns/{explored[1]}/samples"
    form = Page(visit(home).text).form(home)
    assert form["least.J1"] == form["most.FC-1"] == ""
    sent = {**form, "sort": "margin", "x": "J1", "y": "FC-1", "least.J1": "0.07", "most.FC-1": " 13 "}
    sent.pop("status", None)
    address = f"{home}?x=J1&y=FC-1&range=J1%3A0.07%3A&range=FC-1%3A%3A13"
    assert visit(home, status=303, params=sent).headers["location"] == address
    answer = visit(home, params=sent, headers={"HX-Request": "true"})
    assert answer.headers["hx-replace-url"] == address
    text = visit(address).text
    form = Page(text).form(home)
    assert (form["least.J1"], form["most.FC-1"], form["most.J1"]) == ("0.07", "13", "")
    assert text.count("<circle") == text.count("<polyline") > 0
    assert "allowed: COLUMN:LEAST:MOST" in visit(f"{home}?range=J1:x:").text
    assert "allowed: COLUMN:LEAST:MOST" in visit(f"{home}?range=none").text


def test_drawn_samples_lead_to_their_motion(visit, explored):
    home = f"/campaigns/{explored[2]}/samples"
    text = visit(home, "viewer").text
    for n in range(4):
        assert text.count(f'<a href="{home}/{n}?pictures=true" tabindex="-1" aria-label="Sample {n}">') == 2


def test_replay_of_a_sample(visit, submit, explored):
    """The form says whether the bits are the same; of rows that a stand-in computed they are not."""
    home = f"/campaigns/{explored[2]}/samples/3"
    text = visit(home, "viewer").text
    assert f"/api/v1{home}/plot.svg" not in text
    assert "data-motion" not in text
    text = visit(f"{home}?pictures=true", "viewer").text
    assert Page(text).faults == []
    for kind in ("motion.gif", "motion.json", "plot.svg"):
        assert f"/api/v1{home}/{kind}" in text
    assert '<figure class="motion"' in text
    answer = submit(f"{home}/replay", "viewer")
    assert 'Same bits: <strong class="good">yes' in answer.text
    assert Page(answer.text).faults == []
    answer = submit(f"{home}/replay".replace(explored[2], explored[0]))
    assert 'Same bits: <strong class="fault">no' in answer.text
    assert visit(f"/campaigns/{explored[2]}/samples/4", status=422)


def test_replay_of_another_site(computing, explored):
    client, _ = computing
    assert client.post(f"/campaigns/{explored[2]}/samples/3/replay").status_code == 401
