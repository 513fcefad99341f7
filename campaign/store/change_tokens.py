"""Detect which campaigns have changed by a token for each, computed from a listing without opening a file.

The token of a campaign changes with its plan, state, lease, rows, repeats, labels, report and comparisons. Heartbeats
and the log do not affect it, nor does damage to a file in place. A campaign whose state is ``running`` can end without
any file changing, if its coordinator dies, so such campaigns must be observed (`campaign.coordinator.follow.observe`).
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Mapping

from campaign.store.files.files import TEMPORARY
from campaign.store.layout import COMPARISONS, HEARTBEAT, LOG, PLAN
from campaign.store.store import Store
from campaign.store.which_campaign import folders_of_campaigns

_IRRELEVANT = (HEARTBEAT, LOG)


def change_token(store: Store, campaign_id: str) -> str | None:
    """Return the token of one campaign, given by its full id; None if there is no such campaign."""
    stamps = store.files.stamps(campaign_id)
    if PLAN not in stamps:
        return None
    # a file written into a comparison changes the stamp of that comparison's own folder only
    if store.files.local and COMPARISONS in stamps:
        folder = f"{campaign_id}/{COMPARISONS}"
        stamps |= {f"{COMPARISONS}/{other}": stamp for other, stamp in store.files.stamps(folder).items()}
    return _token(stamps)


def change_tokens(store: Store) -> dict[str, str]:
    """Return the token of each campaign of a store, by id.

    In a folder this takes one listing per campaign and one stat of each of its files and folders, but does not read the
    folders of rows. On S3 it takes one request per thousand files of the store, so compact complete campaigns.
    """
    if store.files.local:
        tokens = {name: change_token(store, name) for name in store.folders()}
        return {name: token for name, token in tokens.items() if token is not None}
    by_folder: defaultdict[str, dict[str, str]] = defaultdict(dict)
    for path, stamp in store.files.stamps("").items():
        folder, _, name = path.partition("/")
        by_folder[folder][name] = stamp
    return {name: _token(by_folder[name]) for name in folders_of_campaigns(by_folder) if PLAN in by_folder[name]}


def _token(stamps: Mapping[str, str]) -> str:
    """Return a digest of the stamps that matter."""
    relevant = {n: stamp for n, stamp in stamps.items() if n not in _IRRELEVANT and not n.endswith(TEMPORARY)}
    return hashlib.sha256(json.dumps(relevant, sort_keys=True).encode()).hexdigest()[:32]
