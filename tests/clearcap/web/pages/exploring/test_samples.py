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
