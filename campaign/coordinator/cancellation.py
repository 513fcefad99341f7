"""End a campaign on request."""

from campaign.coordinator.lease import is_coordinated
from campaign.coordinator.state import state_of, write_state
from campaign.store import Store
from campaign.store.layout import CANCEL


def cancel_campaign(store: Store, campaign_id: str) -> str:
    """End a campaign, unless it is ``completed``, and return its previous state.

    Unfinished runs are abandoned, finished rows stay. Raises StoreError if the store cannot be written.
    """
    before = str(state_of(store, campaign_id)["state"])
    if before != "completed":
        store.files.write(f"{campaign_id}/{CANCEL}", b"")
        # otherwise its coordinator finds the marker and writes the state
        if not is_coordinated(store, campaign_id):
            write_state(store, campaign_id, "cancelled")
    return before
