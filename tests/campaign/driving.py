"""Compute campaigns with a stand-in for the physics, and compare their rows."""

from campaign.cluster.cluster import Cluster
from campaign.coordinator.coordinate import coordinate
from campaign.coordinator.submit import submit
from campaign.store import open_store
from campaign.store.store import repeated_shares
from campaign.worker.batch import run_batch
from campaign.worker.messages import BatchRequest, CampaignAddress
from tests.campaign import fake_engine


def start(folder, campaign, workers=2, batch_size=3, simulate=fake_engine.simulate, show=lambda _: None):
    """Coordinate a campaign to its end in a store of its own; return the store and the outcome."""
    store = open_store(str(folder))
    plan = submit(store, campaign, batch_size)
    return store, coordinate(store, plan, Cluster(workers=workers), show, simulate)


def rows(store, driven):
    """Return the columns that must not depend on how a campaign is computed, of an outcome or a plan."""
    plan = getattr(driven, "plan", driven)
    return store.table(plan.campaign_id).drop_columns(["wall_s", "attempts"])


def computed(folder, campaign, batch_size, simulate=fake_engine.simulate):
    """Compute a campaign in this process, without a cluster; return the store and the plan."""
    store = open_store(str(folder))
    plan = submit(store, campaign, batch_size)
    address = CampaignAddress.of(store, plan, simulate, repeated_shares(store, plan))
    for batch in range(len(plan.batches)):
        run_batch(address, BatchRequest(batch))
    return store, plan
