"""Heartbeats of a process that holds a lease and computes nothing: by them other machines know that it lives."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from campaign.coordinator.lease import HEARTBEAT_INTERVAL
from campaign.errors import StoreError
from campaign.store import Store
from campaign.store.files.patience import Outage
from campaign.store.layout import HEARTBEAT


@contextmanager
def beating(store: Store, folder: str) -> Iterator[None]:
    """Write a heartbeat into a folder of the store every two seconds while the block runs.

    Parameters
    ----------
    store : Store
        Where the lease is.
    folder : str
        Id of a campaign, or `campaign.store.layout.SERVICE`.
    """
    over, hasty, outage = threading.Event(), store.hasty, Outage(store.url, store.files.patience)

    def write_heartbeats() -> None:
        count = 0
        while not over.is_set():
            count += 1
            try:
                hasty.write_json(folder, HEARTBEAT, {"beat": count, "time": time.time()})
                outage.end()
            except StoreError as error:
                outage.begin(error)
            over.wait(HEARTBEAT_INTERVAL)

    thread = threading.Thread(target=write_heartbeats, name=f"heartbeats of {folder}", daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
