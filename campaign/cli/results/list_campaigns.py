"""``clearcap list``: the campaigns of a store."""

from typing import TYPE_CHECKING, Any

from campaign.cli.options import StoreUrl
from campaign.cli.output import Json, print_json, print_text, say, visible
from campaign.cli.results.differences import add_differences, in_words
from campaign.cli.results.status import progress

if TYPE_CHECKING:
    from campaign.store import Store

COLUMNS = ("campaign", "state", "done", "failed", "left", "when", "title")


def list_campaigns(store: StoreUrl = "runs", json: Json = False) -> None:
    """List the campaigns of a store: progress, date and title, and what differs between those of one title."""
    from campaign.store import open_store
    from campaign.store.files.patience import QUICK
    from campaign.store.which_campaign import check_is_store

    opened = open_store(store, QUICK)
    check_is_store(opened.files)
    entries = [_entry(opened, campaign_id) for campaign_id in opened.campaigns()]
    add_differences(opened, entries)
    if json:
        print_json(entries)
        return
    if not entries:
        say(f"store {opened.url}: holds no campaign; make one: {opened.command('run', 'CAMPAIGN')}")
        return
    lines = [COLUMNS, *([_cell(entry, column) for column in COLUMNS] for entry in entries)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print_text("  ".join(f"{cell:{width}}" for cell, width in zip(line, widths, strict=True)).rstrip())
    for entry in entries:
        if entry["fault"]:
            say(f"{entry['campaign']}: {entry['fault']}")


def _cell(entry: dict[str, Any], column: str) -> str:
    """Return a cell of the list."""
    value = entry[column]
    if value is None:
        return "-"
    if column == "when":  # the time here, without its offset
        return str(value)[:16].replace("T", " ")
    differences = in_words(entry["differs"]) if column == "title" else ""
    return visible(f"{value} ({differences})" if differences else str(value))


def _entry(store: "Store", campaign_id: str) -> dict[str, Any]:
    """Return what the list says of a campaign; of a broken one, what is wrong with it."""
    from campaign.errors import CampaignError

    entry: dict[str, Any] = dict.fromkeys((*COLUMNS, "samples", "fault")) | {"differs": {}}
    entry |= {"campaign": campaign_id, "state": "broken"}
    try:
        header = store.plan_header(campaign_id)
        state, counts = progress(store, header)
    except CampaignError as error:
        return entry | {"fault": str(error)}
    entry |= {"title": header.title, "state": state["state"], "when": state["since"], "fault": state["fault"]}
    return entry | {key: counts[key] for key in ("samples", "done", "failed", "left")}
