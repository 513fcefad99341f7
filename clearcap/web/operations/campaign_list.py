"""The list of campaigns: its filters, orders, and cursors, which stay valid when campaigns come and go."""

import base64
import json
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, Field, TypeAdapter, ValidationError, field_validator

from campaign.errors import SpecError
from clearcap.web.watch.entry import LISTED_STATES, CampaignEntry

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
MOST_LISTED = 1000


class Listing(BaseModel):
    """A page of the list of campaigns."""

    campaigns: list[CampaignEntry]
    total: int = Field(description="Campaigns that match the search", examples=[1])
    next: str | None = Field(description="Cursor of the next page; null on the last one")
    unread: int = Field(
        description="Number of campaigns in the store that have not been read and listed yet; ask again until it is 0",
        examples=[0],
    )
    fault: str = Field(description="Why the store cannot be read and the list is an earlier one; empty if it can")


class ListQuestion(BaseModel):
    """The filters and the order of a list of campaigns."""

    search: str = Field("", max_length=200, description="Part of the id, title, owner, tags, or note")
    owner: str | None = Field(None, max_length=200)
    tag: list[str] = Field(default=[], max_length=20, description="Only campaigns with all of these tags")
    state: str | None = Field(None, pattern=f"^({'|'.join(LISTED_STATES)})$")
    archived: bool = Field(False, description="Include archived campaigns")
    sort: str = Field("newest", pattern=f"^({'|'.join(ORDERS)})$")

    @field_validator("state", mode="before")
    @classmethod
    def _empty_stands_for_all(cls, value: Any) -> Any:
        """Return the state, or None for an empty text, which a form sends if none is chosen."""
        return value or None


def listed(entries: Iterable[tuple[CampaignEntry, bytes]], question: ListQuestion) -> list[tuple[CampaignEntry, bytes]]:
    """Return the entries that match a question, in its order; entries with equal keys are sorted by id."""
    words = question.search.casefold().split()
    return in_order([pair for pair in entries if _fits(pair[0], question, words)], question.sort)


def _fits(entry: CampaignEntry, question: ListQuestion, words: list[str]) -> bool:
    """Return whether an entry matches a question."""
    if entry.archived and not question.archived:
        return False
    if question.owner not in (None, entry.owner) or question.state not in (None, entry.state):
        return False
    if not set(question.tag) <= set(entry.tags):
        return False
    text = " ".join((entry.campaign, entry.title, entry.owner, *entry.tags, entry.note)).casefold() if words else ""
    return all(word in text for word in words)


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
    """Return the campaigns, sorted by `order`, after a cursor of `cursor_after`; an empty one is the first page."""
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
