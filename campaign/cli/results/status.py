"""``clearcap status``: the progress of a campaign."""

from typing import Any

import typer

from campaign.cli.at_server import ServerUrl, asked_server, command_at
from campaign.cli.options import Id, StoreUrl
from campaign.cli.output import Json, print_json, print_text, say

ENDED = ("cancelled", "failed", "interrupted", "incomplete")  # states that only `resume` changes


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
        from campaign.store import open_store
        from campaign.store.files.retry_policy import QUICK

        opened = open_store(store, QUICK)
        document = progress_report(opened, opened.plan_header(opened.find(campaign)), say)
        command = opened.command("resume", document["campaign"])
    if json:
        print_json(document)
    else:
        _show(document, command)


def _show(document: dict[str, Any], command: str) -> None:
    """Print the progress of a campaign, and the command that continues it."""
    done_so_far = "{done} of {samples} done, {failed} failed, {left} left".format_map(document)
    repeats = f", {document['repeated']} of {document['repeats']} repeats" if document["repeats"] else ""
    print_text(f"{document['campaign']}: {document['state']}, {done_so_far}{repeats}")
    if document["message"]:
        print_text(f"  {document['message']}")
    if heartbeat := document["heartbeat"]:
        from campaign.cli.progress import eta

        print_text(f"  {heartbeat['rate']:.1f} runs/s on {heartbeat['workers']} workers, ETA {eta(heartbeat['eta_s'])}")
    for status, count in document["statuses"].items():
        if status != "ok":
            print_text(f"  {count} {status}")
    for other, place in document["comparisons"].items():
        print_text(f"  compared with {other}: {place}")
    if document["state"] in ENDED:
        print_text(f"  continue it with: {command}")
