"""Delete a campaign: plan, rows and report.

First the plan gets another name, in one step: from then on the campaign is none, so that no interruption leaves one
that seems to have lost rows. Then the rest goes, and what bears that name last. A deletion that was interrupted is
finished by the next one of the same campaign, or before the campaign is submitted again.
"""

from campaign.coordinator.lease import beating, check_lease, hold_lease
from campaign.store import Store
from campaign.store.files.files import TEMPORARY
from campaign.store.layout import DELETED, HEARTBEAT, LEASE, PLAN


def delete_campaign(store: Store, campaign_id: str) -> None:
    """Delete the folder of a campaign with all that it holds; or finish a deletion that was interrupted.

    It takes up to ten seconds where another machine holds the lease, and as long as the files take to remove.

    Parameters
    ----------
    store : Store
        Where the campaign is.
    campaign_id : str
        Its whole id.

    Raises
    ------
    LeaseHeld
        If a process computes it, or deletes it already.
    StoreError
        If it cannot be deleted.
    """
    with hold_lease(store, campaign_id) as token:
        _remove_all(store, campaign_id, token)
    store.files.remove(campaign_id)


def _remove_all(store: Store, campaign_id: str, token: str) -> None:
    """Remove all but the lease, which the caller holds."""
    with beating(store, campaign_id):
        if store.files.exists(f"{campaign_id}/{PLAN}"):
            store.files.move(f"{campaign_id}/{PLAN}", f"{campaign_id}/{DELETED}")
        for name in store.files.names(campaign_id):
            # not the next heartbeat, which is being written
            if name not in (DELETED, LEASE, HEARTBEAT) and not name.endswith(TEMPORARY):
                check_lease(store, campaign_id, token)  # who was away for long may come back to a new campaign
                store.files.remove_tree(f"{campaign_id}/{name}")
    left = [name for name in store.files.names(campaign_id) if name not in (DELETED, LEASE)]
    for name in (*left, DELETED):
        check_lease(store, campaign_id, token)
        store.files.remove_tree(f"{campaign_id}/{name}")


def is_half_deleted(store: Store, campaign_id: str) -> bool:
    """Return whether a deletion of a campaign has begun and is not finished."""
    return not store.files.exists(f"{campaign_id}/{PLAN}") and store.files.exists(f"{campaign_id}/{DELETED}")


def unfinished_deletions(store: Store) -> list[str]:
    """Return the ids of the campaigns whose deletion has begun and is not finished, sorted."""
    return [name for name in store.folders() if is_half_deleted(store, name)]


def finish_deletion(store: Store, campaign_id: str) -> None:
    """Finish the deletion of a campaign, if one was interrupted; raises what `delete_campaign` raises."""
    if not is_half_deleted(store, campaign_id):
        return
    with hold_lease(store, campaign_id) as token:
        if is_half_deleted(store, campaign_id):  # another process may have finished it: the campaign may be a new one
            _remove_all(store, campaign_id, token)
    store.files.remove(campaign_id)
