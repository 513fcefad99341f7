"""``clearcap resume``: continue a campaign."""

from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.at_server import AT_SERVER, ServerUrl, asked_server
from campaign.cli.drive import drive
from campaign.cli.options import Id, NoReport, StoreUrl, on_cluster
from campaign.cli.output import Json, print_json, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster


@on_cluster
def resume(
    context: typer.Context,
    where: "Cluster",
    campaign: Id = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
    detach: Annotated[
        bool, typer.Option("--detach", help="Hand the campaign to a coordinator and return, as submit does.")
    ] = False,
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Continue a campaign that was interrupted or cancelled, or that failed; at a server it is queued."""
    if remote := asked_server(context, server):
        with remote:
            campaign_id = remote.find(campaign)
            note = remote.resume(campaign_id)["note"]
        say(f"campaign {campaign_id}: {note}")
        if json:
            print_json({"campaign": campaign_id, "store": remote.address, **AT_SERVER})
        return
    from campaign.coordinator.submit import assign_coordinator
    from campaign.store import open_store
    from campaign.store.layout import CANCEL

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    opened.remove(plan.campaign_id, CANCEL)
    if not detach:
        drive(opened, plan, where, with_report=not no_report, as_json=json)
        return
    assignment = assign_coordinator(opened, plan, where.options())
    say(assignment.text(opened))
    if json:
        print_json({"campaign": plan.campaign_id, "store": opened.url, **assignment.to_json()})
