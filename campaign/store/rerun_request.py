"""The request that failed rows of a campaign be computed again: a document in the store that a coordinator fulfils."""

import time
from collections.abc import Iterable
from dataclasses import dataclass

from campaign.errors import StoreError
from campaign.run_status import FailedStatus
from campaign.store.layout import RERUN
from campaign.store.store import Store


@dataclass(frozen=True)
class RerunRequest:
    """What is to be computed again.

    Attributes
    ----------
    statuses : tuple of str
        Rows with one of these statuses; all failed rows if there are none.
    by : str
        Who asked for it.
    """

    statuses: tuple[str, ...] = ()
    by: str = ""


def request_rerun(store: Store, campaign_id: str, statuses: Iterable[str], by: str) -> None:
    """Ask that failed rows be computed again; it takes the place of an earlier request."""
    document = {"statuses": sorted(set(statuses)), "by": by, "time": time.time()}
    store.write_json(campaign_id, RERUN, document)


def rerun_request(store: Store, campaign_id: str) -> RerunRequest | None:
    """Return what is to be computed again; None if nobody has asked, or it is done.

    Raises
    ------
    StoreError
        If the document cannot be read, or is not what clearcap wrote.
    """
    document = store.read_json(campaign_id, RERUN)
    if document is None:
        return None
    statuses = document.get("statuses")
    if not isinstance(statuses, list) or not set(map(str, statuses)) <= {*FailedStatus}:
        raise StoreError(f"store {store.url}: {campaign_id}/{RERUN} is not what clearcap wrote; remove it")
    return RerunRequest(tuple(statuses), str(document.get("by", ""))[:200])
