"""``clearcap delete``: remove a campaign from its store."""

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.options import CampaignId, StoreUrl
from campaign.cli.output import Json, print_json, print_text, say, visible

if TYPE_CHECKING:
    from campaign.store import Store


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
    from campaign.store.naming import which_campaign

    opened = open_store(store, QUICK)
    begun = unfinished_deletions(opened)
    campaign_id = which_campaign(opened.files, sorted([*opened.campaigns(), *begun]), campaign)
    if is_coordinated(opened, campaign_id):
        command = opened.command("cancel", campaign_id)
        raise CampaignError(f"{campaign_id} is being computed; to delete it, end it first with: {command}")
    rows = None if campaign_id in begun else _rows(opened, campaign_id)
    content = "its plan and its report" if rows is None else f"its plan, its {rows} rows and its report"
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


def _rows(store: "Store", campaign_id: str) -> Any:
    """Return the number of rows that would be lost; None if the campaign cannot be read."""
    from campaign.coordinator.progress_report import progress
    from campaign.errors import CampaignError

    try:
        return progress(store, store.plan_header(campaign_id), say)[1]["done"]
    except CampaignError:
        return None
