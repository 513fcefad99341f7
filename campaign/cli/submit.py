"""``clearcap submit``: have a coordinator compute a campaign."""

from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.options import BatchSize, Campaign, Samples, Seed, StoreUrl, on_cluster
from campaign.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster


@on_cluster
def submit(
    where: "Cluster",
    campaign: Campaign,
    samples: Samples = None,
    seed: Seed = None,
    store: StoreUrl = "runs",
    batch_size: BatchSize = None,
    queue_only: Annotated[
        bool, typer.Option("--queue-only", help="Only queue the campaign, for a coordinator that serves the store.")
    ] = False,
    owner: Annotated[
        str | None, typer.Option(metavar="NAME", help="Who answers for a new campaign; by default you.")
    ] = None,
    tag: Annotated[list[str], typer.Option(metavar="TAG", help="Give it a tag; may be repeated.")] = [],  # noqa: B006
    json: Json = False,
) -> None:
    """Hand a campaign to a coordinator in the background, print its id, and return.

    If a coordinator serves the store, it computes the campaign; otherwise one is started, which goes on after this
    terminal is closed.
    """
    from campaign.coordinator.plan_campaign import plan_campaign
    from campaign.coordinator.submit import assign_coordinator
    from campaign.store.labels import LabelChange

    labels = LabelChange(owner, tuple(tag))
    opened, plan = plan_campaign(campaign, store, samples, seed, batch_size, labels)
    assignment = assign_coordinator(opened, plan, where.options(), queue_only=queue_only)
    say(f"campaign {plan.campaign_id}: {plan.spec.samples} samples, store {opened.url}; {assignment.text(opened)}")
    if json:
        print_json(
            {"campaign": plan.campaign_id, "store": opened.url, "samples": plan.spec.samples, **assignment.to_json()}
        )
    else:
        print_text(plan.campaign_id)
