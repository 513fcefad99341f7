"""``clearcap run`` and ``submit``: a new campaign, computed here or by a coordinator elsewhere."""

from typing import TYPE_CHECKING, Annotated

import typer

from campaign.cli.drive import drive, options_of
from campaign.cli.options import StoreUrl, on_cluster
from campaign.cli.output import Json, print_json, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster
    from campaign.plan import Plan
    from campaign.store import Store

Campaign = Annotated[str, typer.Argument(help="A shipped campaign (c60) or a campaign file.")]
Samples = Annotated[int | None, typer.Option(help="Samples, instead of the file's.")]
Seed = Annotated[int | None, typer.Option(help="Seed, instead of the file's.")]
BatchSize = Annotated[int | None, typer.Option(min=1, help="Samples a batch, of a new campaign; default: about 10 s.")]
NoReport = Annotated[bool, typer.Option("--no-report", help="Leave the report out.")]


@on_cluster
def run(
    where: "Cluster",
    campaign: Campaign,
    samples: Samples = None,
    seed: Seed = None,
    store: StoreUrl = "runs",
    batch_size: BatchSize = None,
    no_report: NoReport = False,
    json: Json = False,
) -> None:
    """Simulate a campaign to its end and write its capability report.

    The same command goes on where an earlier one stopped, and computes nothing when the campaign is complete.
    """
    from campaign.store.layout import CANCEL

    opened, plan = _planned(campaign, store, samples, seed, batch_size)
    opened.remove(plan.campaign_id, CANCEL)
    say(f"campaign {plan.campaign_id}: {plan.spec.samples} samples, store {store}")
    drive(opened, plan, where, with_report=not no_report, as_json=json)


@on_cluster
def submit(
    where: "Cluster",
    campaign: Campaign,
    samples: Samples = None,
    seed: Seed = None,
    store: StoreUrl = "runs",
    batch_size: BatchSize = None,
    queue_only: Annotated[
        bool, typer.Option("--queue-only", help="Leave it to a coordinator that serves the store.")
    ] = False,
    json: Json = False,
) -> None:
    """Plan a campaign, have a coordinator compute it, and return; prints its id.

    A coordinator that serves the store takes it over; otherwise one is started, which outlives this terminal.
    """
    from campaign.coordinator.submit import assign_coordinator

    opened, plan = _planned(campaign, store, samples, seed, batch_size)
    assignment = assign_coordinator(opened, plan, options_of(where), queue_only=queue_only)
    say(f"campaign {plan.campaign_id}: {plan.spec.samples} samples, store {store}; {assignment.text()}")
    if json:
        print_json(
            {"campaign": plan.campaign_id, "store": opened.url, "samples": plan.spec.samples, **assignment.to_json()}
        )
    else:
        print(plan.campaign_id)


def _planned(
    campaign: str, url: str, samples: int | None, seed: int | None, batch_size: int | None
) -> "tuple[Store, Plan]":
    """Check all that the user gave, then write the plan."""
    from campaign.coordinator.submit import submit
    from campaign.errors import SpecError
    from campaign.spec.load import load_campaign
    from campaign.store import open_store

    opened = open_store(url)
    if not opened.files.shared:
        raise SpecError(f"store {url}: workers cannot reach the memory of this process; name a folder or a URL")
    loaded = load_campaign(campaign, samples=samples, seed=seed)
    opened.files.check_writable()
    return opened, submit(opened, loaded, batch_size)
