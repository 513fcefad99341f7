"""Verbs that keep a store tidy: ``label``, ``compact`` and ``delete``."""

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.waits import counted
from clearcap.cli.options import CampaignId, Id, StoreUrl
from clearcap.cli.output import Json, print_json, print_text, say, visible

if TYPE_CHECKING:
    from campaign.store import Store

Tags = Annotated[list[str], typer.Option(metavar="TAG", help="Give it a tag; may be repeated.")]
Untag = Annotated[list[str], typer.Option(metavar="TAG", help="Remove a tag; may be repeated.")]


def label(
    campaign: CampaignId,
    owner: Annotated[
        str | None, typer.Option(metavar="NAME", help="Owner of the campaign; '' removes the owner.")
    ] = None,
    tag: Tags = [],  # noqa: B006
    untag: Untag = [],  # noqa: B006
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

    No row depends on them, and neither does the id. Simultaneous changes of two people are both made.
    """
    from campaign.coordinator.submit import user_name
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK
    from campaign.store.labels import LabelChange, change_labels

    change = LabelChange(owner, tuple(tag), tuple(untag), note, archive)
    opened = open_store(store, QUICK)
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
    from campaign.store import open_store
    from campaign.store.store import repeat_plans

    opened = open_store(store)
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
    from campaign.coordinator.requests import delete_campaign, unfinished_deletions
    from campaign.errors import CampaignError, SpecError
    from campaign.store import open_store
    from campaign.store.files.retry_policy import QUICK
    from campaign.store.store import which_campaign

    opened = open_store(store, QUICK)
    begun = unfinished_deletions(opened)
    campaign_id = which_campaign(opened.files, sorted([*opened.campaigns(), *begun]), campaign)
    if is_coordinated(opened, campaign_id):
        command = opened.command("cancel", campaign_id)
        raise CampaignError(f"{campaign_id} is being computed; to delete it, end it first with: {command}")
    rows = None if campaign_id in begun else _rows_lost(opened, campaign_id)
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


def _rows_lost(store: "Store", campaign_id: str) -> Any:
    """Return the number of rows that would be lost; None if the campaign cannot be read."""
    from campaign.coordinator.progress_report import progress
    from campaign.errors import CampaignError

    try:
        return progress(store, store.plan_header(campaign_id), say)[1]["done"]
    except CampaignError:
        return None
