"""``clearcap repeat``: simulate samples of a campaign a second time, with half the step."""

from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.drive import drive
from campaign.cli.options import CampaignId, NoReport, StoreUrl, on_cluster
from campaign.cli.output import Json, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster


@on_cluster
def repeat(
    where: "Cluster",
    campaign: CampaignId,
    share: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Share of the samples to repeat; counting those that already are.")
    ] = 0.1,
    store: StoreUrl = "runs",
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Repeat samples with half the step, so that the report tells how far results depend on it."""
    from campaign.coordinator.lease import hold_lease
    from campaign.store import open_store
    from campaign.store.layout import CANCEL
    from campaign.store.repeat_sets import add_share, repeated_shares
    from campaign.worker.messages import check_build

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    check_build(plan.campaign_id, plan.row_build)
    with hold_lease(opened, plan.campaign_id):
        before = repeated_shares(opened, plan)[-1]
        add_share(opened, plan, share)
    if share <= before:
        say(f"{plan.campaign_id} repeats {before:g} of its samples already; for more give a larger --share")
    opened.remove(plan.campaign_id, CANCEL)
    drive(opened, plan, where, with_report=not no_report, as_json=json)
