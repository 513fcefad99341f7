"""Author and dates of a campaign, for the head of its report."""

import os
import time
from datetime import UTC, datetime

from campaign.errors import SpecError
from campaign.plan import Plan
from campaign.store import Store
from campaign.store.layout import STATE, SUBMISSION

BUILD_DATE = "SOURCE_DATE_EPOCH"  # reproducible-builds.org/docs/source-date-epoch
_LATEST = 32_503_680_000.0  # s since 1970: the year 3000


def author(plan: Plan, store: Store | None) -> str:
    """Return the person responsible for a campaign: its author, else the author in its header, else the submitter."""
    if plan.spec.author is not None:
        return plan.spec.author
    named = next((text for name, text in plan.spec.header.items() if name.strip().lower() == "author"), "")
    submission = None if named or store is None else store.read_json(plan.campaign_id, SUBMISSION)
    user = (submission or {}).get("user")
    return named or (user if isinstance(user, str) else "")


def campaign_end(plan: Plan, store: Store | None) -> str:
    """Return when a campaign was completed; empty if it is not complete, or its store has no date."""
    state = None if store is None else store.read_json(plan.campaign_id, STATE)
    since = (state or {}).get("since")
    if (state or {}).get("state") != "completed" or isinstance(since, bool) or not isinstance(since, int | float):
        return ""
    return _in_utc(since) if 0.0 <= since < _LATEST else ""


def report_date() -> str:
    """Return the current time, or that of SOURCE_DATE_EPOCH, with which a report can be reproduced bit for bit.

    Raises SpecError if SOURCE_DATE_EPOCH is not a number of seconds since 1970.
    """
    given = os.environ.get(BUILD_DATE)
    if given is None:
        return _in_utc(time.time())
    if not (given.isascii() and given.isdigit() and int(given) < _LATEST):
        raise SpecError(f"{BUILD_DATE} = {given!r:.40}: not a date; allowed: whole seconds since 1970, or unset it")
    return _in_utc(int(given))


def _in_utc(seconds: float) -> str:
    """Return a time [s since 1970] as a date in UTC with hours and minutes."""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M UTC")
