"""The progress of campaigns from counted rows, which are counted again only when files have changed."""

import time
from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Any

from campaign.coordinator.progress_report import progress_report, running_report
from campaign.store import Store
from campaign.store.store import change_token

MOST_KEPT = 2000  # campaigns
RECOUNT_AFTER = 60.0  # s; needed because damage to a file in place does not change the token
RESTING = ("completed", "incomplete", "cancelled", "failed", "planned")  # states that last until a file changes


class CountedStatuses:
    """Count the rows of campaigns; thread-safe."""

    def __init__(self, store: Store, clock: Callable[[], float] = time.monotonic) -> None:
        self._store, self._clock, self._lock = store, clock, Lock()
        self._kept: OrderedDict[str, tuple[str, float, dict[str, Any]]] = OrderedDict()  # token, time, and document

    def status(self, campaign: str) -> dict[str, Any]:
        """Return the `progress_report` of a campaign, with the faults of its files as ``remarks``.

        The counts of a running campaign are those of its coordinator, at most some seconds old. Raises StoreError if
        the store cannot be read, or has no such campaign.
        """
        token = change_token(self._store, campaign)
        with self._lock:
            known = self._kept.get(campaign)
        if known is not None and known[0] == token and self._clock() - known[1] < RECOUNT_AFTER:
            return known[2]
        remarks: list[str] = []
        document = running_report(self._store, campaign, remarks.append)
        if document is None:
            remarks.clear()
            document = progress_report(self._store, self._store.plan_header(campaign), remarks.append)
        document["remarks"] = remarks
        with self._lock:
            self._kept.pop(campaign, None)
            if token is not None and document["state"] in RESTING:
                self._kept[campaign] = token, self._clock(), document
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return document
