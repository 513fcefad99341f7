"""The histograms of the rows so far: the numbers of the what-if page, and none before the first row."""

import re

import pytest

from clearcap.web.jobs.pool import Busy
from reporting import format_numbers
from reporting.capability.intervals import cpk_interval
from tests.clearcap.web.pages.forms import Page

pytestmark = pytest.mark.processes


def test_histograms_with_limits_and_intervals(visit, explored, computing, computing_service):
    client, headers = computing
    call = f"/api/v1/campaigns/{explored[1]}/histogram"
    bins = client.get(call, params={"response": "FC-1"}, headers=headers("viewer")).json()
    text = visit(f"/campaigns/{explored[1]}/histograms", "viewer").text
    card = text.partition('aria-label="FC-1">')[2].partition("</article>")[0]
    assert card.count('class="before"') == len(bins["before"])
    low, high = cpk_interval(bins["cpk"], 400, 0.95)
    shown = re.search(r"400 values, Cpk ([^ ]+) <span class=\"interval\">\(([^ ]+) to ([^ )]+)\)", card).groups()
    assert shown == tuple(format_numbers.index(x) for x in (bins["cpk"], low, high))
    assert card.count('<text class="limit"') == 2


def test_page_of_a_campaign_asks_for_them(visit, explored):
    """By itself with scripts, by a link without."""
    text = visit(f"/campaigns/{explored[1]}").text
    home = f"/campaigns/{explored[1]}/histograms"
    assert f'hx-get="{home}" hx-trigger="load"' in text
    assert f'<a href="{home}">' in text


def test_nothing_to_show_is_no_error(visit, explored, computing_service, monkeypatch):
    """A page that asks again by itself must not fill a console with refusals."""

    async def busy(*_):
        raise Busy("many jobs wait", 3)

    monkeypatch.setattr(computing_service[0].answers, "ask", busy)
    text = visit(f"/campaigns/{explored[1]}/histograms").text
    assert "many jobs wait" in text
    assert Page(text).faults == []
