"""Verbs on the campaigns of a store: ``list``, ``status``, ``watch``, ``label``, ``compact`` and ``delete``."""

import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.errors import CampaignError, SpecError, StoreError
from campaign.waits import counted
from clearcap.cli.options import CampaignId, Id, ServerUrl, StoreUrl, asked_server, command_at, opened_store
from clearcap.cli.output import Json, console, display, eta, print_json, print_text, say, visible

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
        of_owner = {} if owner is None else {"owner": owner}
        with remote:
            listed = [_entry_of_server(each) for each in remote.campaigns(archived=True, tag=tag, **of_owner)]
        entries = [each for each in listed if archived or not each["archived"]]
        hidden, begun = len(listed) - len(entries), dict[str, str]()
        without = f"server {remote.address}: has no campaign to show; submit one"
    else:
        from campaign.coordinator.requests import unfinished_deletions
        from campaign.store.store import check_is_store

        opened = opened_store(store)
        check_is_store(opened.files)
        labelled = [(campaign_id, *_labels(opened, campaign_id)) for campaign_id in opened.campaigns()]
        found = [each for each in labelled if each[1].has(owner, tag)]
        entries = [_entry(opened, *each) for each in found if archived or not each[1].archived]
        add_differences(opened, entries)
        hidden = len(found) - len(entries)
        begun = {each: opened.command("delete", each) for each in unfinished_deletions(opened)}
        without = f"store {opened.url}: holds no campaign; make one: {opened.command('run', 'CAMPAIGN')}"
        if labelled:
            without = f"store {opened.url}: none of its {len(labelled)} campaigns is listed with these options"
    if json:
        print_json(entries)
        return
    for campaign_id, command in begun.items():
        say(f"{campaign_id}: its deletion was interrupted; finish it with: {command}")
    if hidden:
        say(f"{hidden} archived campaign{'s are' if hidden > 1 else ' is'} left out; show all with --archived")
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


def _entry_of_server(listed: dict[str, Any]) -> dict[str, Any]:
    """Return the entry of a server's campaign in the list; differences from others of its title are not known here."""
    since = listed["since"]
    date = None if since is None else datetime.fromisoformat(since).astimezone().isoformat(timespec="seconds")
    same = ("campaign", "state", "done", "failed", "left", "owner", "tags", "title", "samples")
    entry: dict[str, Any] = {name: listed[name] for name in same} | {"when": date, "differs": {}}
    entry |= {name: listed[name] for name in ("note", "archived", "labels_version")}
    return entry | {"fault": listed["message"] if listed["state"] == "broken" else None}


def _list_cell(entry: dict[str, Any], column: str) -> str:
    value = entry[column]
    if value is None or value in ("", []):
        return "-"
    if column == "tags":
        return visible(", ".join(value))
    if column == "when":  # local time, without its offset
        return str(value)[:16].replace("T", " ")
    if column != "title" or not entry["differs"]:
        return visible(str(value))
    from clearcap.questions.plan_differences import shortened

    shown = [f"{key} = {shortened(value)}" for key, value in list(entry["differs"].items())[:MOST_SHOWN]]
    others = len(entry["differs"]) - MOST_SHOWN
    return visible(f"{value} ({', '.join(shown)}{f' and {others} more' if others > 0 else ''})")


def _labels(store: "Store", campaign_id: str) -> tuple["Labels", str | None]:
    from campaign.store.labels import Labels, read_labels

    try:
        return read_labels(store, campaign_id), None
    except StoreError as error:
        return Labels(), str(error)


def _entry(store: "Store", campaign_id: str, labels: "Labels", fault: str | None) -> dict[str, Any]:
    """Return the entry of a campaign in the list; for a broken campaign, with what is wrong."""
    from campaign.coordinator.progress_report import progress

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
    from clearcap.questions.plan_differences import plan_keys

    by_title = defaultdict(list)
    for entry in entries:
        if entry["title"] is not None:
            by_title[entry["title"]].append(entry)
    for alike in (alike for alike in by_title.values() if len(alike) > 1):
        plans = [plan_keys(store, entry["campaign"]) for entry in alike]
        names = dict.fromkeys(name for plan in plans for name in plan)
        differing = [name for name in names if any(plan.get(name) != plans[0].get(name) for plan in plans)]
        for entry, plan in zip(alike, plans, strict=True):
            entry["differs"] = {name: plan.get(name) for name in differing}


def status(
    context: typer.Context, campaign: Id = None, store: StoreUrl = "runs", server: ServerUrl = None, json: Json = False
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

        opened = opened_store(store)
        document = progress_report(opened, opened.plan_header(opened.find(campaign)), say)
        command = resume_command(opened, document["campaign"])
    if json:
        print_json(document)
    else:
        _print_status(document, command)


def _print_status(document: dict[str, Any], command: str) -> None:
    done_so_far = "{done} of {samples} done, {failed} failed, {left} left".format_map(document)
    repeats = f", {document['repeated']} of {document['repeats']} repeats" if document["repeats"] else ""
    print_text(f"{document['campaign']}: {document['state']}, {done_so_far}{repeats}")
    if document["message"]:
        print_text(f"  {document['message']}")
    has_stopped = document["state"] in ENDED
    if heartbeat := document["heartbeat"]:
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
    context: typer.Context, campaign: Id = None, store: StoreUrl = "runs", server: ServerUrl = None, json: Json = False
) -> None:
    """Follow the progress of a campaign until its coordinator ends; Ctrl-C stops only this display."""
    if remote := asked_server(context, server):
        with remote:
            campaign_id = remote.find(campaign)
            command = command_at(remote, "watch", campaign_id)
            last = _follow(_heartbeats_of(remote, campaign_id), campaign_id, command)
    else:
        from campaign.coordinator.heartbeat import heartbeats

        opened = opened_store(store, is_patient=True)
        campaign_id = opened.find(campaign)
        last = _follow(heartbeats(opened, campaign_id), campaign_id, opened.command("watch", campaign_id))
    if json and last:
        print_json(last.to_json())


def _follow(heartbeats: "Iterable[Heartbeat]", campaign_id: str, command: str) -> "Heartbeat | None":
    """Show heartbeats as they arrive; return the last one."""
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


def label(
    campaign: CampaignId,
    owner: Annotated[
        str | None, typer.Option(metavar="NAME", help="Owner of the campaign; '' removes the owner.")
    ] = None,
    tag: Annotated[list[str], typer.Option(metavar="TAG", help="Give it a tag; may be repeated.")] = [],  # noqa: B006
    untag: Annotated[list[str], typer.Option(metavar="TAG", help="Remove a tag; may be repeated.")] = [],  # noqa: B006
    note: Annotated[str | None, typer.Option(metavar="TEXT", help="A note, instead of the present one.")] = None,
    archive: Annotated[
        bool | None, typer.Option("--archive/--restore", help="Leave it out of lists, or show it again.")
    ] = None,
    version: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="Refuse if the labels have another version.")
    ] = None,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Change the labels of a campaign, and show them: owner, tags, note, and whether it is archived.

    No row depends on them, and neither does the id. If two people change them at once, both changes are kept.
    """
    from campaign.coordinator.submit import user_name
    from campaign.store.labels import LabelChange, change_labels

    change = LabelChange(owner, tuple(tag), tuple(untag), note, archive)
    opened = opened_store(store)
    campaign_id = opened.find(campaign)
    labels = change_labels(opened, campaign_id, change, by=user_name(), version=version)
    if json:
        print_json({"campaign": campaign_id, "store": opened.url, **labels.to_json()})
        return
    tags = f"tags {', '.join(labels.tags)}" if labels.tags else "no tags"
    archived = ", archived" if labels.archived else ""
    print_text(f"{campaign_id}: owner {labels.owner or '-'}, {tags}{archived} (version {labels.version})")
    for line in labels.note.splitlines():
        print_text(f"  {line}")


def compact(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """Merge the part files of a campaign into a few larger files; the campaign may be running."""
    from campaign.coordinator.requests import unsigned
    from campaign.coordinator.state import resume_command
    from campaign.store.store import repeat_plans

    opened = opened_store(store, is_patient=True)
    header = opened.plan_header(opened.find(campaign))
    with unsigned(opened, header.campaign_id):
        rows = opened.compact(header)
        repeats = {table.folder: opened.compact(table) for table in repeat_plans(opened, header)}
    results = [rows, *repeats.values()]
    resume = resume_command(opened, header.campaign_id)
    for reason in dict.fromkeys(reason for result in results for reason in result.bad.values()):
        say(f"{reason}: left as it is; compute its samples again with: {resume}")
    written = [*rows.written, *(f"{folder}/{name}" for folder, result in repeats.items() for name in result.written)]
    removed, files = sum(result.removed for result in results), sum(result.files for result in results)
    if json:
        document = {"campaign": header.campaign_id, "store": opened.url, "written": written}
        print_json({**document, "removed": removed, "files": files, "bad_batches": sorted(rows.bad)})
        return
    merged = f"{counted(removed, 'file')} merged into {len(written)}"
    print_text(f"{header.campaign_id}: {merged}; the campaign has {counted(files, 'file')} of rows now")


def delete(
    campaign: CampaignId,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Delete without asking.")] = False,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Delete a campaign for good: its plan, its rows and its report; or finish a deletion that was interrupted."""
    from campaign.coordinator.lease import is_coordinated
    from campaign.coordinator.progress_report import progress
    from campaign.coordinator.requests import delete_campaign, unfinished_deletions
    from campaign.store.store import which_campaign

    opened = opened_store(store)
    begun = unfinished_deletions(opened)
    campaign_id = which_campaign(opened.files, sorted([*opened.campaigns(), *begun]), campaign)
    if is_coordinated(opened, campaign_id):
        command = opened.command("cancel", campaign_id)
        raise CampaignError(f"{campaign_id} is being computed; to delete it, end it first with: {command}")
    rows = None  # not known if the campaign cannot be read
    if campaign_id not in begun:
        with suppress(CampaignError):
            rows = progress(opened, opened.plan_header(campaign_id), say)[1]["done"]
    content = "its plan and its report" if rows is None else f"its plan, its {counted(rows, 'row')} and its report"
    if not yes and campaign_id not in begun:
        if json or not sys.stdin.isatty():
            raise SpecError(
                f"{campaign_id} is not deleted: {content} would be gone for good; add --yes if you want that"
            )
        question = f"Delete {campaign_id} from {opened.url}: {content}?"
        typer.confirm(visible(question), abort=True, err=True)
    delete_campaign(opened, campaign_id)
    if json:
        print_json({"campaign": campaign_id, "store": opened.url, "rows": rows})
    else:
        print_text(f"{campaign_id} is deleted: {content}")
