"""``clearcap submit``: hand a campaign to a coordinator."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from campaign.cli.at_server import AT_SERVER, ServerUrl, asked_server
from campaign.cli.options import BatchSize, Campaign, Samples, Seed, StoreUrl, on_cluster
from campaign.cli.output import Json, print_json, print_text, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster


@on_cluster
def submit(
    context: typer.Context,
    where: "Cluster",
    campaign: Campaign,
    samples: Samples = None,
    seed: Seed = None,
    store: StoreUrl = "runs",
    server: ServerUrl = None,
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
    terminal is closed. A server gets the campaign file with the files that it names, which must lie beside it, and
    decides itself where and in which batches it computes.
    """
    if remote := asked_server(context, server):
        if batch_size is not None or where.options():
            from campaign.errors import SpecError

            raise SpecError("--server: decides where and in which batches it computes; leave those options out")
        from campaign.spec.open_campaign_questions import campaign_questions

        for question in campaign_questions(campaign):
            say(question)
        with remote:
            made = remote.submit(campaign, samples=samples, seed=seed, owner=owner, tags=tag)
        words = "; ".join(filter(None, (made["cost"]["text"], made["note"])))
        say(f"campaign {made['campaign']}: {made['samples']} samples, server {remote.address}; {words}")
        document = {"campaign": made["campaign"], "store": remote.address, "samples": made["samples"]}
        _print(document | AT_SERVER, json)
        return
    from campaign.coordinator.submit import assign_coordinator, plan_campaign
    from campaign.store.labels import LabelChange

    labels = LabelChange(owner, tuple(tag))
    opened, plan = plan_campaign(campaign, store, samples, seed, batch_size, labels)
    assignment = assign_coordinator(opened, plan, where.options(), queue_only=queue_only)
    say(f"campaign {plan.campaign_id}: {plan.spec.samples} samples, store {opened.url}; {assignment.text(opened)}")
    document = {"campaign": plan.campaign_id, "store": opened.url, "samples": plan.spec.samples}
    _print(document | assignment.to_json(), json)


def _print(document: dict[str, Any], as_json: bool) -> None:
    """Print the id, or the whole document as JSON."""
    if as_json:
        print_json(document)
    else:
        print_text(document["campaign"])
