"""``clearcap label``: owner, tags and note of a campaign, and whether lists leave it out."""

from typing import Annotated

import typer

from campaign.cli.options import CampaignId, StoreUrl
from campaign.cli.output import Json, print_json, print_text

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
