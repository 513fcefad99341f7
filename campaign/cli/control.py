"""``clearcap coordinate``, ``resume`` and ``cancel``: continue a campaign, or end it."""

import signal
from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.drive import drive, options_of
from campaign.cli.options import Id, StoreUrl, on_cluster
from campaign.cli.output import Json, print_json, say
from campaign.cli.run import NoReport

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster


@on_cluster
def coordinate(
    where: "Cluster",
    campaign: Annotated[str | None, typer.Argument(help="Id of the campaign; without it, all that are queued.")] = None,
    store: StoreUrl = "runs",
    once: Annotated[bool, typer.Option("--once", help="Without an id: end when nothing is queued.")] = False,
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Compute a planned campaign; without an id serve the store: compute every campaign that is queued.

    Made for a supervisor: it may be killed at any time and started again.
    """
    from campaign.store import open_store

    signal.signal(signal.SIGTERM, _terminate)
    opened = open_store(store)
    if campaign is None:
        from campaign.coordinator.service import serve

        completed = serve(opened, where, once=once, with_report=not no_report)
        if json:
            print_json({"store": opened.url, "campaigns": completed})
        return
    drive(opened, opened.plan(opened.find(campaign)), where, with_report=not no_report, as_json=json)


@on_cluster
def resume(
    where: "Cluster",
    campaign: Id = None,
    store: StoreUrl = "runs",
    detach: Annotated[bool, typer.Option("--detach", help="Leave it to a coordinator, as submit does.")] = False,
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Go on with a campaign that was interrupted or cancelled, or that failed."""
    from campaign.coordinator.submit import assign_coordinator
    from campaign.store import open_store
    from campaign.store.layout import CANCEL

    opened = open_store(store)
    plan = opened.plan(opened.find(campaign))
    opened.remove(plan.campaign_id, CANCEL)
    if not detach:
        drive(opened, plan, where, with_report=not no_report, as_json=json)
        return
    assignment = assign_coordinator(opened, plan, options_of(where))
    say(assignment.text())
    if json:
        print_json({"campaign": plan.campaign_id, "store": opened.url, **assignment.to_json()})


def cancel(campaign: Id = None, store: StoreUrl = "runs", json: Json = False) -> None:
    """End a campaign after the runs in hand; what is finished stays, and ``resume`` goes on."""
    from campaign.coordinator.lease import is_coordinated
    from campaign.coordinator.state import state_of, write_state
    from campaign.store import open_store
    from campaign.store.layout import CANCEL

    opened = open_store(store)
    campaign_id = opened.find(campaign)
    before = state_of(opened, campaign_id)["state"]
    if before != "completed":
        opened.files.write(f"{campaign_id}/{CANCEL}", b"")
        if not is_coordinated(opened, campaign_id):
            write_state(opened, campaign_id, "cancelled")
    if json:
        print_json({"campaign": campaign_id, "store": opened.url, "before": before})
    elif before == "completed":
        print(f"{campaign_id} is completed; nothing to cancel")
    else:
        print(f"{campaign_id} was {before}; go on with: clearcap resume {campaign_id} --store {opened.url}")


def _terminate(*_: Any) -> None:
    """Exit in order on SIGTERM; the campaign stays open for the next coordinator."""
    raise SystemExit(143)
