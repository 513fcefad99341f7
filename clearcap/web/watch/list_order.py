"""Orders of the list of campaigns, and cursors to its pages, which stay valid when campaigns come and go."""

import base64
import json
import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from campaign.errors import SpecError
from clearcap.web.watch.entry import CampaignEntry

LONGEST_CURSOR = 2000  # characters
_LONGEST_WORD = 200  # characters of a text that are compared
Key = tuple[float, str]
Listed = TypeVar("Listed", bound=tuple[CampaignEntry, object])

_PLACE = TypeAdapter(tuple[str, float, str, str])  # order, key and id of the last campaign of a page


def _submitted(entry: CampaignEntry) -> Key:
    return (entry.submitted_at.timestamp() if entry.submitted_at else 0.0), ""


def _word(text: str) -> Key:
    return 0.0, text.casefold()[:_LONGEST_WORD]


ORDERS: dict[str, tuple[Callable[[CampaignEntry], Key], bool]] = {  # sort key, and whether the order is descending
    "newest": (_submitted, True),
    "oldest": (_submitted, False),
    "title": (lambda e: _word(e.title), False),
    "cpk": (lambda e: (e.weakest.cpk if e.weakest else math.inf, ""), False),
    "yield": (lambda e: (math.inf if e.share_ok is None else e.share_ok, ""), False),
    "state": (lambda e: _word(e.state), False),
    "owner": (lambda e: _word(e.owner), False),
}


def in_order(found: Sequence[Listed], order: str) -> list[Listed]:
    """Return campaigns sorted by one of the `ORDERS`; campaigns with equal keys are sorted by id."""
    key, falls = ORDERS[order]
    by_id = sorted(found, key=lambda each: each[0].campaign)
    return sorted(by_id, key=lambda each: key(each[0]), reverse=falls)


def cursor_after(entry: CampaignEntry, order: str) -> str:
    """Return the cursor of the page that begins after a campaign; it consists of letters, digits, ``-`` and ``_``."""
    number, word = ORDERS[order][0](entry)
    place = json.dumps([order, number, word, entry.campaign], ensure_ascii=False)
    return base64.urlsafe_b64encode(place.encode(errors="backslashreplace")).decode().rstrip("=")


def after_cursor(found: Sequence[Listed], order: str, cursor: str) -> Sequence[Listed]:
    """Return the campaigns, sorted by `order`, after a cursor from `cursor_after`; an empty cursor is the first page.

    Raises SpecError if the cursor does not belong to a list in this order.
    """
    if not cursor:
        return found
    try:
        text = base64.b64decode(cursor + "=" * (-len(cursor) % 4), altchars=b"-_", validate=True)
        given, number, word, campaign = _PLACE.validate_json(text)
    except (ValueError, ValidationError) as error:
        raise _no_cursor(cursor, order) from error
    if given != order:
        raise _no_cursor(cursor, order)
    key, falls = ORDERS[order]
    place = number, word

    def comes_after(entry: CampaignEntry) -> bool:
        own = key(entry)
        return entry.campaign > campaign if own == place else (own < place) == falls

    return [each for each in found if comes_after(each[0])]


def _no_cursor(cursor: str, order: str) -> SpecError:
    """Return the error for an invalid cursor."""
    return SpecError(
        f"cursor = {cursor!r:.60}: of no list that is sorted by {order}; begin without one, then send `next` of the"
        " answer before"
    )
