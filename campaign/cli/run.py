"""``clearcap run``: compute a campaign to its end in this process."""

from typing import TYPE_CHECKING

from campaign.cli.drive import drive
from campaign.cli.options import BatchSize, Campaign, NoReport, Samples, Seed, StoreUrl, on_cluster
from campaign.cli.output import Json, say

if TYPE_CHECKING:
    from campaign.cluster.cluster import Cluster


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

    The same command, given again, continues where the earlier one stopped, and computes nothing if the campaign is
    complete.
    """
    from campaign.cluster.dask_workers import PrestartedWorkers
    from campaign.coordinator.submit import plan_campaign
    from campaign.store.layout import CANCEL

    with PrestartedWorkers(where) as early:
        opened, plan = plan_campaign(campaign, store, samples, seed, batch_size, when_new=early.begin)
        opened.remove(plan.campaign_id, CANCEL)
        say(f"campaign {plan.campaign_id}: {plan.spec.samples} samples, store {opened.url}")
        drive(opened, plan, where, with_report=not no_report, as_json=json, early=early)
