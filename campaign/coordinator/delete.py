"""Delete a campaign: plan, rows and report."""

from campaign.coordinator.lease import hold_lease
from campaign.store import Store
from campaign.store.layout import LEASE, PLAN


def delete_campaign(store: Store, campaign_id: str) -> None:
    """Delete the folder of a campaign with all that it holds.

    The plan goes last, so that a campaign whose deletion was interrupted is still listed and can be deleted again.

    Parameters
    ----------
    store : Store
        Where the campaign is.
    campaign_id : str
        Its whole id.

    Raises
    ------
    LeaseHeld
        If a process computes it.
    StoreError
        If it cannot be deleted.
    """
    files = store.files
    with hold_lease(store, campaign_id):
        for name in files.names(campaign_id):
            if name not in (PLAN, LEASE):
                files.remove_tree(f"{campaign_id}/{name}")
        files.remove_tree(campaign_id)
