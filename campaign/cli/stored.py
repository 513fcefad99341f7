"""``clearcap list`` and ``clearcap compact``: what a store holds, and fewer files for it."""

from datetime import datetime
from typing import TYPE_CHECKING, Any

from campaign.cli.campaigns import Id, StoreUrl
from campaign.cli.output import Json, print_json, say

if TYPE_CHECKING:
    from campaign.store import Store


def list_campaigns(store: StoreUrl = "runs", json: Json = False) -> None:
    """List the campaigns of a store and how far each is."""
    from campaign.store import open_store

    opened = open_store(store)
    entries = [_entry(opened, campaign_id) for campaign_id in opened.campaigns()]
    if json:
        print_json(entries)
        return
    lines = [_COLUMNS, *(["-" if entry[key] is None else str(entry[key]) for key in _COLUMNS] for entry in entries)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print("  ".join(f"{cell:{width}}" for cell, width in zip(line, widths, strict=True)).rstrip())
    for entry in entries:
        if entry["fault"]:
            say(f"{entry['campaign']}: {entry['fault']}")


_COLUMNS = ("campaign", "state", "done", "failed", "left", "when", "title")


def _entry(store: "Store", campaign_id: str) -> dict[str, Any]:
    """Return what is to be said of a campaign; of a broken one, what is wrong with it."""
    from campaign.cli.campaigns import progress
    from campaign.coordinator.state import state_of
    from campaign.errors import CampaignError

    entry: dict[str, Any] = dict.fromkeys((*_COLUMNS, "samples", "fault"))
    entry |= {"campaign": campaign_id, "state": "broken"}
    try:
        header = store.plan_header(campaign_id)
        counts = progress(store, header)
        state = state_of(store, campaign_id)
    except CampaignError as error:
        return entry | {"fault": str(error)}
    kept = ("samples", "done", "failed", "left")
    since = state["since"]
    when = None if since is None else datetime.fromtimestamp(since).isoformat(sep=" ", timespec="seconds")
    known = {"title": header.title, "state": state["state"], "when": when}
    return entry | known | {key: counts[key] for key in kept}


def compact(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Merge the parts of a campaign into few files; the campaign may be running."""
    from campaign.store import open_store

    opened = open_store(store)
    plan = opened.plan_header(opened.find(campaign))
    done = opened.compact(plan)
    for reason in dict.fromkeys(done.bad.values()):
        say(f"{reason}: left as it is; run the campaign again to replace it")
    if json:
        document = {"campaign": plan.campaign_id, "store": opened.url, "written": done.written}
        print_json({**document, "removed": done.removed, "files": done.files, "bad_batches": sorted(done.bad)})
    else:
        print(f"{plan.campaign_id}: {len(done.written)} files written for {done.removed}; {done.files} files of rows")
