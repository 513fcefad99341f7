"""``clearcap list``: the campaigns of a store."""

from datetime import datetime
from typing import TYPE_CHECKING, Any

from campaign.cli.options import StoreUrl
from campaign.cli.output import Json, print_json, print_text, say, visible
from campaign.cli.results.status import count_rows

if TYPE_CHECKING:
    from campaign.store import Store

COLUMNS = ("campaign", "state", "done", "failed", "left", "when", "title")


def list_campaigns(store: StoreUrl = "runs", json: Json = False) -> None:
    """List the campaigns of a store and their progress."""
    from campaign.store import open_store
    from campaign.store.files.patience import QUICK

    opened = open_store(store, QUICK)
    entries = [_entry(opened, campaign_id) for campaign_id in opened.campaigns()]
    if json:
        print_json(entries)
        return
    cells = (["-" if entry[key] is None else visible(str(entry[key])) for key in COLUMNS] for entry in entries)
    lines = [COLUMNS, *cells]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print_text("  ".join(f"{cell:{width}}" for cell, width in zip(line, widths, strict=True)).rstrip())
    for entry in entries:
        if entry["fault"]:
            say(f"{entry['campaign']}: {entry['fault']}")


def _entry(store: "Store", campaign_id: str) -> dict[str, Any]:
    """Return what the list says of a campaign; of a broken one, what is wrong with it."""
    from campaign.coordinator.state import state_of
    from campaign.errors import CampaignError

    entry: dict[str, Any] = dict.fromkeys((*COLUMNS, "samples", "fault"))
    entry |= {"campaign": campaign_id, "state": "broken"}
    try:
        header = store.plan_header(campaign_id)
        counts = count_rows(store, header)
        state = state_of(store, campaign_id)
    except CampaignError as error:
        return entry | {"fault": str(error)}
    since = state["since"]
    when = None if since is None else datetime.fromtimestamp(since).isoformat(sep=" ", timespec="seconds")
    entry |= {"title": header.title, "state": state["state"], "when": when, "fault": state["fault"]}
    return entry | {key: counts[key] for key in ("samples", "done", "failed", "left")}
