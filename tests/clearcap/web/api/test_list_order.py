"""Pages of a list that changes meanwhile: what stays is on exactly one of them."""

from datetime import UTC, datetime

import pytest

from campaign.errors import SpecError
from clearcap.web.index import CampaignEntry, Weakest
from clearcap.web.operations.campaigns import LONGEST_CURSOR, ORDERS, after_cursor, cursor_after, in_order

ON_A_PAGE = 3


def entry(i):
    """Return a campaign of which much is the same as of others."""
    return CampaignEntry(
        campaign=f"c-{i:02}",
        title=f"Latch {i % 5} ü",
        state=("completed", "running")[i % 2],
        owner=("", "eva")[i % 2],
        submitted_at=datetime(2026, 11, 1 + i % 4, tzinfo=UTC) if i % 7 else None,
        weakest=Weakest(response="F", cpk=1.0 - i % 3) if i % 5 else None,
        share_ok=0.1 * (i % 3) if i % 4 else None,
    )


def pages(order, change):
    """Yield the campaigns of each page; `change` is told how many there were, and returns what there is now."""
    cursor, count = "", 0
    while True:
        found = [(each, b"") for each in map(entry, change(count))]
        rest = after_cursor(in_order(found, order), order, cursor)
        yield [each.campaign for each, _ in rest[:ON_A_PAGE]]
        if len(rest) <= ON_A_PAGE:
            return
        cursor, count = cursor_after(rest[ON_A_PAGE - 1][0], order), count + 1


@pytest.mark.parametrize("order", ORDERS)
def test_all_once_in_order(order):
    read = [each for page in pages(order, lambda _: range(20)) for each in page]
    assert read == [each.campaign for each, _ in in_order([(entry(i), b"") for i in range(20)], order)]
    assert len(set(read)) == 20


@pytest.mark.parametrize("order", ORDERS)
def test_what_stays_is_on_one_page(order):
    """Others come before and behind the end of each page, and go, the last one of the page too."""
    kept = set(range(0, 40, 2))
    read = [each for page in pages(order, lambda page: kept | {2 * page + 1, 39 - 2 * page}) for each in page]
    assert len(read) == len(set(read))
    assert set(read) >= {f"c-{i:02}" for i in kept}


def test_long_titles_fit_into_a_cursor():
    """Those that are the same as far as they count are told apart by their ids."""
    long = [
        CampaignEntry(campaign=f"c-{i}" + "x" * 90, title="ü" * 5000 + str(9 - i), state="running") for i in range(3)
    ]
    cursor = cursor_after(long[0], "title")
    assert len(cursor) < LONGEST_CURSOR
    found = in_order([(each, b"") for each in long], "title")
    assert [each for each, _ in after_cursor(found, "title", cursor)] == long[1:]


@pytest.mark.parametrize("cursor", ["1", "ü", "W10", cursor_after(entry(1), "title")])
def test_another_cursor(cursor):
    with pytest.raises(SpecError, match=r"\bnewest\b"):
        after_cursor([], "newest", cursor)
