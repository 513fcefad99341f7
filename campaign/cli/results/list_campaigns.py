"""``clearcap list``: the campaigns of a store."""

from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.at_server import ServerUrl, asked_server
from campaign.cli.options import StoreUrl
from campaign.cli.output import Json, print_json, print_text, say, visible
from campaign.cli.results.differences import add_differences, in_words

if TYPE_CHECKING:
    from campaign.store import Store
    from campaign.store.labels import Labels

COLUMNS = ("campaign", "state", "done", "failed", "left", "when", "owner", "tags", "title")


def list_campaigns(
    context: typer.Context,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    owner: Annotated[str | None, typer.Option(metavar="NAME", help="Only the campaigns of this owner.")] = None,
    tag: Annotated[list[str], typer.Option(metavar="TAG", help="Only campaigns with this tag; may be repeated.")] = [],  # noqa: B006
    archived: Annotated[bool, typer.Option("--archived", help="Show archived campaigns too.")] = False,
    json: Json = False,
) -> None:
    """List the campaigns of a store: progress, date, owner, tags, title, and what differs between those of one title.

    Campaigns that somebody archived are left out.
    """
    if remote := asked_server(context, server):
        with remote:
            listed = [_entry_of_server(each) for each in remote.campaigns(archived=True, **_question(owner, tag))]
        shown_here = [each for each in listed if archived or not each["archived"]]
        if json:
            print_json(shown_here)
            return
        _say_hidden(len(listed) - len(shown_here))
        _show(shown_here, f"server {remote.address}: has no campaign to show; submit one")
        return
    from campaign.coordinator.requests import unfinished_deletions
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK
    from campaign.store.naming import check_is_store

    opened = open_store(store, QUICK)
    check_is_store(opened.files)
    labelled = [(campaign_id, *_labels(opened, campaign_id)) for campaign_id in opened.campaigns()]
    found = [each for each in labelled if each[1].has(owner, tag)]
    shown = [each for each in found if archived or not each[1].archived]
    entries = [_entry(opened, *each) for each in shown]
    add_differences(opened, entries)
    if json:
        print_json(entries)
        return
    for campaign_id in unfinished_deletions(opened):
        command = opened.command("delete", campaign_id)
        say(f"{campaign_id}: its deletion was interrupted; finish it with: {command}")
    _say_hidden(len(found) - len(shown))
    if not entries and labelled:
        say(f"store {opened.url}: none of its {len(labelled)} campaigns is listed with these options")
        return
    _show(entries, f"store {opened.url}: holds no campaign; make one: {opened.command('run', 'CAMPAIGN')}")


def _say_hidden(count: int) -> None:
    """Print how many campaigns are left out."""
    if count:
        say(f"{count} archived campaign{'s are' if count > 1 else ' is'} left out; show all with --archived")


def _show(entries: list[dict[str, Any]], without: str) -> None:
    """Print the list, or a message that there are no campaigns."""
    if not entries:
        say(without)
        return
    lines = [COLUMNS, *([_cell(entry, column) for column in COLUMNS] for entry in entries)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        print_text("  ".join(f"{cell:{width}}" for cell, width in zip(line, widths, strict=True)).rstrip())
    for entry in entries:
        if entry["fault"]:
            say(f"{entry['campaign']}: {entry['fault']}")


def _question(owner: str | None, tags: list[str]) -> dict[str, Any]:
    """Return the parameters of the request to a server."""
    return {"tag": tags} | ({} if owner is None else {"owner": owner})


def _entry_of_server(listed: dict[str, Any]) -> dict[str, Any]:
    """Return the entry of a server's campaign in the list; differences from others of its title are not known here."""
    since = listed["since"]
    date = None if since is None else datetime.fromisoformat(since).astimezone().isoformat(timespec="seconds")
    same = ("campaign", "state", "done", "failed", "left", "owner", "tags", "title", "samples")
    entry: dict[str, Any] = {name: listed[name] for name in same} | {"when": date, "differs": {}}
    entry |= {name: listed[name] for name in ("note", "archived", "labels_version")}
    return entry | {"fault": listed["message"] if listed["state"] == "broken" else None}


def _cell(entry: dict[str, Any], column: str) -> str:
    """Return a cell of the list."""
    value = entry[column]
    if value is None or value in ("", []):
        return "-"
    if column == "tags":
        return visible(", ".join(value))
    if column == "when":  # local time, without its offset
        return str(value)[:16].replace("T", " ")
    differences = in_words(entry["differs"]) if column == "title" else ""
    return visible(f"{value} ({differences})" if differences else str(value))


def _labels(store: "Store", campaign_id: str) -> tuple["Labels", str | None]:
    """Return the labels of a campaign and None; if they cannot be read, empty labels and what is wrong."""
    from campaign.errors import StoreError
    from campaign.store.labels import Labels, read_labels

    try:
        return read_labels(store, campaign_id), None
    except StoreError as error:
        return Labels(), str(error)


def _entry(store: "Store", campaign_id: str, labels: "Labels", fault: str | None) -> dict[str, Any]:
    """Return the entry of a campaign in the list; for a broken campaign, with what is wrong."""
    from campaign.coordinator.progress_report import progress
    from campaign.errors import CampaignError

    entry: dict[str, Any] = dict.fromkeys((*COLUMNS, "samples")) | {"differs": {}, "fault": fault}
    said = labels.to_json()
    entry |= {"campaign": campaign_id, "state": "broken", "labels_version": said.pop("version"), **said}
    try:
        header = store.plan_header(campaign_id)
        state, counts = progress(store, header, say)
    except CampaignError as error:
        return entry | {"fault": str(error)}
    entry |= {"title": header.title, "state": state["state"], "when": state["since"]}
    entry |= {"fault": fault or state["fault"]}
    return entry | {key: counts[key] for key in ("samples", "done", "failed", "left")}
