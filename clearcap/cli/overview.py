"""Verbs that show how far campaigns are: ``list``, ``status`` and ``watch``."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from clearcap.cli.options import Id, ServerUrl, StoreUrl, asked_server, command_at
from clearcap.cli.output import Json, console, print_json, print_text, say, visible

if TYPE_CHECKING:
    from campaign.coordinator.heartbeat import Heartbeat
    from campaign.store import Store
    from campaign.store.labels import Labels
    from clearcap.client.remote_server import RemoteServer


ENDED = ("cancelled", "failed", "interrupted", "incomplete")  # states that only `resume` changes
MOST_SHOWN = 3  # differences of a campaign in the list
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
        _print_list(shown_here, f"server {remote.address}: has no campaign to show; submit one")
        return
    from campaign.coordinator.requests import unfinished_deletions
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK
    from campaign.store.store import check_is_store

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
    _print_list(entries, f"store {opened.url}: holds no campaign; make one: {opened.command('run', 'CAMPAIGN')}")


def _say_hidden(count: int) -> None:
    """Print how many campaigns are left out."""
    if count:
        say(f"{count} archived campaign{'s are' if count > 1 else ' is'} left out; show all with --archived")


def _print_list(entries: list[dict[str, Any]], without: str) -> None:
    """Print the list, or a message that there are no campaigns."""
    if not entries:
        say(without)
        return
    lines = [COLUMNS, *([_list_cell(entry, column) for column in COLUMNS] for entry in entries)]
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


def _list_cell(entry: dict[str, Any], column: str) -> str:
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


def add_differences(store: "Store", entries: list[dict[str, Any]]) -> None:
    """Add to campaigns with the same title, as ``differs``, the keys in which their plans differ, with their values.

    Each entry has ``campaign`` and ``title``, which is None if the campaign cannot be read.
    """
    by_title = defaultdict(list)
    for entry in entries:
        if entry["title"] is not None:
            by_title[entry["title"]].append(entry)
    for alike in by_title.values():
        if len(alike) > 1:
            _compare(store, alike)


def in_words(differs: Mapping[str, Any]) -> str:
    """Return the first differences of a campaign in words."""
    from clearcap.questions.plan_differences import shortened

    shown = [f"{key} = {shortened(value)}" for key, value in list(differs.items())[:MOST_SHOWN]]
    others = len(differs) - MOST_SHOWN
    return ", ".join(shown) + (f" and {others} more" if others > 0 else "")


def _compare(store: "Store", alike: list[dict[str, Any]]) -> None:
    """Add the differences between these campaigns to each of them."""
    from clearcap.questions.plan_differences import plan_keys

    plans = [plan_keys(store, entry["campaign"]) for entry in alike]
    names = dict.fromkeys(name for plan in plans for name in plan)
    differing = [name for name in names if any(plan.get(name) != plans[0].get(name) for plan in plans)]
    for entry, plan in zip(alike, plans, strict=True):
        entry["differs"] = {name: plan.get(name) for name in differing}


def status(
    context: typer.Context,
    campaign: Id = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    json: Json = False,
) -> None:
    """Show the progress of a campaign: state, rows done, failed and left, and the last message of its coordinator."""
    if remote := asked_server(context, server):
        with remote:
            document = remote.status(remote.find(campaign))
        for remark in document.pop("remarks"):
            say(remark)
        command = command_at(remote, "resume", document["campaign"])
    else:
        from campaign.coordinator.progress_report import progress_report
        from campaign.coordinator.state import resume_command
        from campaign.store import open_store
        from campaign.store.files.retry_policy import QUICK

        opened = open_store(store, QUICK)
        document = progress_report(opened, opened.plan_header(opened.find(campaign)), say)
        command = resume_command(opened, document["campaign"])
    if json:
        print_json(document)
    else:
        _print_status(document, command)


def _print_status(document: dict[str, Any], command: str) -> None:
    """Print the progress of a campaign, and the command that continues it."""
    done_so_far = "{done} of {samples} done, {failed} failed, {left} left".format_map(document)
    repeats = f", {document['repeated']} of {document['repeats']} repeats" if document["repeats"] else ""
    print_text(f"{document['campaign']}: {document['state']}, {done_so_far}{repeats}")
    if document["message"]:
        print_text(f"  {document['message']}")
    has_stopped = document["state"] in ENDED
    if heartbeat := document["heartbeat"]:
        from campaign.waits import counted
        from clearcap.cli.progress import eta

        workers = counted(heartbeat["workers"], "worker")
        print_text(f"  {heartbeat['rate']:.1f} runs/s on {workers}, ETA {eta(heartbeat['eta_s'])}")
        if waits := document.get("waits_for"):
            print_text(f"  {waits}")
        has_stopped |= any(wait["what"] == "coordinator" for wait in heartbeat.get("waiting", []))
    for status, count in document["statuses"].items():
        if status != "ok":
            print_text(f"  {count} {status}")
    for other, place in document["comparisons"].items():
        print_text(f"  compared with {other}: {place}")
    if has_stopped:
        print_text(f"  continue it with: {command}")


def watch(
    context: typer.Context,
    campaign: Id = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    json: Json = False,
) -> None:
    """Follow the progress of a campaign until its coordinator ends; Ctrl-C stops only this display."""
    if remote := asked_server(context, server):
        with remote:
            campaign_id = remote.find(campaign)
            command = command_at(remote, "watch", campaign_id)
            last = _follow(_heartbeats_of(remote, campaign_id), campaign_id, command)
    else:
        from campaign.coordinator.heartbeat import heartbeats
        from campaign.store import open_store

        opened = open_store(store)
        campaign_id = opened.find(campaign)
        last = _follow(heartbeats(opened, campaign_id), campaign_id, opened.command("watch", campaign_id))
    if json and last:
        print_json(last.to_json())


def _follow(heartbeats: "Iterable[Heartbeat]", campaign_id: str, command: str) -> "Heartbeat | None":
    """Show heartbeats as they arrive; return the last one."""
    from clearcap.cli.progress import display

    heartbeat = None
    try:
        with display(console(stderr=True)) as show:
            for heartbeat in heartbeats:
                show(heartbeat)
    except KeyboardInterrupt:
        say(f"no longer watching {campaign_id}, which continues; watch it with: {command}")
        raise typer.Exit(130) from None
    return heartbeat


def _heartbeats_of(remote: "RemoteServer", campaign_id: str) -> "Iterator[Heartbeat]":
    """Yield the events of a server as heartbeats; before a coordinator has written one, count the rows."""
    from campaign.coordinator.heartbeat import Heartbeat

    counts = ("samples", "done", "ok", "failed", "left", "statuses", "repeats", "repeated")
    for event in remote.events(campaign_id):
        counted = event if event["samples"] is not None else remote.status(campaign_id)
        yield Heartbeat(
            **{name: event[name] for name in ("campaign", "state", "message", "eta_s")},
            **{name: counted[name] for name in counts},
            rate=event["rate"] or 0.0,
            workers=event["workers"] or 0,
            waiting=event.get("waiting", []),  # servers of earlier versions do not say
            time=event.get("time") or 0.0,
            responses={name: dict(response) for name, response in event["responses"].items()},
        )
