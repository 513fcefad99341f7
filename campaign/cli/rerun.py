"""``clearcap rerun``: compute failed rows again."""

from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.options import CampaignId, StoreUrl, on_cluster
from campaign.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster


@on_cluster
def rerun(
    where: "Cluster",
    campaign: CampaignId,
    sample: Annotated[list[int] | None, typer.Option(help="Only the sample of this number; may be repeated.")] = None,
    status: Annotated[
        list[str] | None, typer.Option(help="Only runs with this status; may be repeated. By default all failed runs.")
    ] = None,
    store: StoreUrl = "runs",
    json: Json = False,
) -> None:
    """Compute failed rows again, after you have removed the cause of the failures."""
    from campaign.coordinator.rerun import failed_samples
    from campaign.coordinator.rerun import rerun as compute
    from campaign.store import open_store

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    selected = sample or failed_samples(opened, plan, status or ())
    if not selected:
        print_json({"campaign": campaign, "samples": 0}) if json else print_text(
            f"{campaign}: no failed run matches, nothing to compute"
        )
        return
    say(f"computing {len(selected)} rows again")
    result = compute(opened, plan, selected, where)
    if json:
        print_json({"campaign": campaign, "store": opened.url, **result.to_json()})
        return
    counts = ", ".join(f"{count} {status}" for status, count in result.after.items())
    print_text(f"{result.samples} rows computed again: {counts}; update the report with: clearcap report {campaign}")
