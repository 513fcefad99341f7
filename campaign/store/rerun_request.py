"""The request to compute failed rows of a campaign again: a document in the store, fulfilled by a coordinator."""

import time
from collections.abc import Iterable
from dataclasses import dataclass

from campaign.errors import StoreError
from campaign.run_status import FailedStatus
from campaign.store.layout import RERUN
from campaign.store.store import Store


@dataclass(frozen=True)
class RerunRequest:
    """Which failed rows to compute again."""

    statuses: tuple[str, ...] = ()  # of the rows; empty for all failed rows
    by: str = ""  # who requested it


def request_rerun(store: Store, campaign_id: str, statuses: Iterable[str], by: str) -> None:
    """Request that failed rows be computed again; this replaces an earlier request."""
    document = {"statuses": sorted(set(statuses)), "by": by, "time": time.time()}
    store.write_json(campaign_id, RERUN, document)


def rerun_request(store: Store, campaign_id: str) -> RerunRequest | None:
    """Return the open request to compute rows again; None if there is none.

    Raises StoreError if the document cannot be read, or was not written by clearcap.
    """
    document = store.read_json(campaign_id, RERUN)
    if document is None:
        return None
    statuses = document.get("statuses")
    if not isinstance(statuses, list) or not set(map(str, statuses)) <= {*FailedStatus}:
        raise StoreError(f"store {store.url}: {campaign_id}/{RERUN} is not what clearcap wrote; remove it")
    return RerunRequest(tuple(statuses), str(document.get("by", ""))[:200])
