"""What users request of a campaign that exists: to cancel it, to compute failed rows again, to delete it; signing."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass

from campaign.coordinator.lease import LeaseHeld, beating, check_lease, hold_lease, is_coordinated, lease_holder
from campaign.coordinator.state import state_of, write_state
from campaign.errors import CampaignError, FailedStatus, StoreError
from campaign.store import Store
from campaign.store.files.files import TEMPORARY
from campaign.store.layout import CANCEL, DELETED, HEARTBEAT, LEASE, PLAN, RERUN, SIGNED


def cancel_campaign(store: Store, campaign_id: str) -> str:
    """End a campaign, unless it is ``completed``, and return its previous state; finished rows stay."""
    state = state_of(store, campaign_id)
    before = str(state["state"])
    if before != "completed":
        store.files.write(f"{campaign_id}/{CANCEL}", b"")
        # otherwise its coordinator finds the marker and writes the state
        if not is_coordinated(store, campaign_id):
            write_state(store, campaign_id, "cancelled", options=state["options"])
    return before


# -- runs again --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RerunRequest:
    """Which failed rows to compute again."""

    statuses: tuple[str, ...] = ()  # of the rows; empty for all failed rows
    by: str = ""  # who requested it


def request_rerun(store: Store, campaign_id: str, statuses: Iterable[str], by: str) -> None:
    """Request that failed rows be computed again, by a document for a coordinator; this replaces an earlier request."""
    document = {"statuses": sorted(set(statuses)), "by": by, "time": time.time()}
    with unsigned(store, campaign_id):
        store.write_json(campaign_id, RERUN, document)


def rerun_request(store: Store, campaign_id: str) -> RerunRequest | None:
    """Return the open request to compute rows again, None if there is none; StoreError if clearcap did not write it."""
    document = store.read_json(campaign_id, RERUN)
    if document is None:
        return None
    statuses = document.get("statuses")
    if not isinstance(statuses, list) or not set(map(str, statuses)) <= {*FailedStatus}:
        raise StoreError(f"store {store.url}: {campaign_id}/{RERUN} is not what clearcap wrote; remove it")
    return RerunRequest(tuple(statuses), str(document.get("by", ""))[:200])


# -- signed campaigns --------------------------------------------------------------------------------------------------
#
# A marker protects what is signed. Who signs writes it first, with the token of the lease that he holds meanwhile; so
# it means nothing once he has crashed, unless it names an earlier sign-off too. What changes plan, rows or report asks
# for it under the lease, and gets that from no signer; a coordinator has it anyway while there is something to compute,
# and then nothing can be signed.


class SignedCampaign(CampaignError):
    """The campaign is signed; its plan, rows and report are not changed."""


@contextmanager
def being_signed(store: Store, campaign_id: str) -> Iterator[Callable[[str, str], None]]:
    """Protect a campaign from all changes during the block; yield what makes this last, to be called as it ends."""
    # Its arguments are the digest of the sign-off and the signer's name. Raises LeaseHeld or LeaseLost.
    with hold_lease(store, campaign_id) as token:
        earlier = store.read_json(campaign_id, SIGNED)
        if earlier is not None and "document" not in earlier:  # left by a signer who crashed
            earlier = None
        store.write_json(campaign_id, SIGNED, {**(earlier or {}), "token": token})

        def last(document: str, signer: str) -> None:
            nonlocal earlier
            check_lease(store, campaign_id, token)
            earlier = {"document": document, "signer": signer, "time": time.time()}

        try:
            yield last
        finally:
            if earlier is None:
                end_protection(store, campaign_id)
            else:
                store.write_json(campaign_id, SIGNED, earlier)


def end_protection(store: Store, campaign_id: str) -> None:
    """Let a campaign be changed again, because its sign-off was withdrawn."""
    store.remove(campaign_id, SIGNED)


def is_protected(store: Store, campaign_id: str) -> bool:
    """Return whether a campaign is marked as signed, which it stays if the server crashes."""
    return "document" in (store.read_json(campaign_id, SIGNED) or {})


def refuse_signed(store: Store, campaign_id: str) -> None:
    """Raise SignedCampaign if a campaign is signed, or being signed."""
    marker = store.read_json(campaign_id, SIGNED)
    if marker is None:
        return
    if "document" not in marker and "token" in marker:
        if marker["token"] == lease_holder(store, campaign_id):
            raise SignedCampaign(f"{campaign_id} is being signed; try again in a minute")
        return
    raise SignedCampaign(
        f"{campaign_id} is signed by {str(marker.get('signer'))[:200]}: its plan, rows and report stay as they are; an"
        " approver can withdraw the sign-off, or archive the campaign"
    )


@contextmanager
def unsigned(store: Store, campaign_id: str) -> Iterator[None]:
    """Keep a campaign from being signed during the block; raise SignedCampaign if it is, or is being signed."""
    with ExitStack() as held:
        with suppress(LeaseHeld):
            held.enter_context(hold_lease(store, campaign_id))
        refuse_signed(store, campaign_id)
        yield


# -- deletion ----------------------------------------------------------------------------------------------------------
#
# First the plan is renamed in one step. From then on the store has no such campaign, so that an interruption cannot
# leave one that seems to have lost rows. Then everything else is removed, and the renamed plan last. An interrupted
# deletion is finished by the next deletion of the same campaign, or before the campaign is submitted again.


def delete_campaign(store: Store, campaign_id: str) -> None:
    """Delete the folder of a campaign with all its content, or finish that; LeaseHeld if a process computes it."""
    with hold_lease(store, campaign_id) as token:
        refuse_signed(store, campaign_id)
        _remove_all(store, campaign_id, token)
    store.files.remove(campaign_id)


def _remove_all(store: Store, campaign_id: str, token: str) -> None:
    """Remove everything except the lease, which the caller holds."""
    with beating(store, campaign_id):
        if store.files.exists(f"{campaign_id}/{PLAN}"):
            store.files.move(f"{campaign_id}/{PLAN}", f"{campaign_id}/{DELETED}")
        for name in store.files.names(campaign_id):
            # keep the temporary file of the next heartbeat, which is being written
            if name not in (DELETED, LEASE, HEARTBEAT) and not name.endswith(TEMPORARY):
                check_lease(store, campaign_id, token)  # after a long pause, there may be a new campaign of this id
                store.files.remove_tree(f"{campaign_id}/{name}")
    left = [name for name in store.files.names(campaign_id) if name not in (DELETED, LEASE)]
    for name in (*left, DELETED):
        check_lease(store, campaign_id, token)
        store.files.remove_tree(f"{campaign_id}/{name}")


def is_half_deleted(store: Store, campaign_id: str) -> bool:
    """Return whether the deletion of a campaign has begun but is not finished."""
    return not store.files.exists(f"{campaign_id}/{PLAN}") and store.files.exists(f"{campaign_id}/{DELETED}")


def unfinished_deletions(store: Store) -> list[str]:
    """Return the sorted ids of the campaigns whose deletion has begun but is not finished."""
    return [name for name in store.folders() if is_half_deleted(store, name)]


def finish_deletion(store: Store, campaign_id: str) -> None:
    """Finish an interrupted deletion of a campaign, if there is one; raises the same errors as `delete_campaign`."""
    if not is_half_deleted(store, campaign_id):
        return
    with hold_lease(store, campaign_id) as token:
        if is_half_deleted(store, campaign_id):  # if another process finished it, the campaign may be a new one
            _remove_all(store, campaign_id, token)
    store.files.remove(campaign_id)
