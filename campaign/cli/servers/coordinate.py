"""``clearcap coordinate``: compute a planned campaign, or serve a store."""

from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.drive import drive
from campaign.cli.options import NoReport, StoreUrl, on_cluster
from campaign.cli.output import Json, print_json

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster


@on_cluster
def coordinate(
    where: "Cluster",
    campaign: Annotated[
        str | None, typer.Argument(help="Id of the campaign; without it, all queued campaigns.")
    ] = None,
    store: StoreUrl = "runs",
    once: Annotated[bool, typer.Option("--once", help="Without an id: end when no campaign is queued.")] = False,
    no_report: NoReport = False,
    parent: Annotated[
        int | None, typer.Option(hidden=True, help="End when this process ends, which has started it.")
    ] = None,
    json: Json = False,
) -> None:
    """Compute a planned campaign; without an id, serve the store: compute every queued campaign.

    A process supervisor may kill and restart it at any time.
    """
    from campaign.cli.termination import terminate_with_parent
    from campaign.store import open_store

    if parent is not None:
        terminate_with_parent(parent)
    opened = open_store(store)
    if campaign is None:
        from campaign.coordinator.service import serve

        completed = serve(opened, where, once=once, with_report=not no_report)
        if json:
            print_json({"store": opened.url, "campaigns": completed})
        return
    drive(opened, opened.plan(opened.find(campaign)), where, with_report=not no_report, as_json=json)
