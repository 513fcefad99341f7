"""The labels of campaigns in their store; no change is lost if several people change them at the same time.

Each change writes a new document, ``labels-000001.json`` and so on, which must not exist yet. If two people change the
same labels at once, one is first; the other change is applied to the new labels, or refused. So no change overwrites
another unseen, even on shared folders without locks. Campaigns of earlier versions have no labels.
"""

import re
import time
from dataclasses import replace
from typing import Any

from campaign.errors import CampaignError, SpecError, StoreError
from campaign.store.labels import LabelChange, Labels
from campaign.store.layout import PLAN, labels_name
from campaign.store.store import Store

LARGEST_LABELS = 2**14  # bytes of a document; labels at their limits fit, with four bytes per character
KEPT = 20  # documents of a campaign; older ones are removed
TRIES = 20  # while others change the same labels at the same time
_NAME = re.compile(r"labels-(\d{6})\.json")


class StaleLabels(CampaignError):
    """Somebody else changed the labels of a campaign after they were read."""


def read_labels(store: Store, campaign_id: str) -> Labels:
    """Return the labels of a campaign; empty ones of version 0 if it has none.

    Raises StoreError if they cannot be read, or were not written by clearcap.
    """
    return _newest(store, campaign_id, 0)


def change_labels(
    store: Store, campaign_id: str, change: LabelChange, *, by: str = "", version: int | None = None
) -> Labels:
    """Change the labels of a campaign, given by its full id, and return the new ones; `by` is who changes them.

    The change is refused with StaleLabels if the labels have another version by now than `version`; None applies it to
    the current labels. Raises SpecError if there is no such campaign, or it would have too many tags; StoreError if the
    labels cannot be read or written.
    """
    # otherwise labels would bring back the folder of a campaign that was deleted
    if not store.files.exists(f"{campaign_id}/{PLAN}"):
        raise SpecError(f"store {store.url}: no campaign {campaign_id}; see: {store.command('list')}")
    at_least = 0
    for _ in range(TRIES):
        labels = _newest(store, campaign_id, at_least)
        if version is not None and labels.version != version:
            raise _stale(campaign_id, labels)
        new = change.applied(labels)
        if new == labels:
            return labels
        new = replace(new, version=labels.version + 1, changed_by=by, changed_at=time.time())
        is_first = store.create_json(campaign_id, labels_name(new.version), new.document())
        if is_first and _prune(store, campaign_id, new.version):
            return new
        at_least = new.version  # a listing of a shared folder may not show it yet
    raise _stale(campaign_id, labels)


def claim(store: Store, campaign_id: str, wanted: LabelChange, by: str = "") -> Labels:
    """Apply a change of labels, but keep the owner if there is one already; return the resulting labels."""
    for _ in range(TRIES):
        labels = read_labels(store, campaign_id)
        change = replace(wanted, owner=None) if labels.owner else wanted
        try:
            return change_labels(store, campaign_id, change, by=by, version=labels.version)
        except StaleLabels:
            continue
    raise _stale(campaign_id, labels)


def _stale(campaign_id: str, labels: Labels) -> StaleLabels:
    who = f" by {labels.changed_by}" if labels.changed_by else ""
    return StaleLabels(
        f"the labels of {campaign_id} have been changed{who} and are now version {labels.version};"
        " look at them and change them again"
    )


def _versions(store: Store, campaign_id: str) -> list[int]:
    """Return the numbers of the listed documents, sorted."""
    found = map(_NAME.fullmatch, store.files.names(campaign_id))
    return sorted(int(name[1]) for name in found if name)


def _newest(store: Store, campaign_id: str, at_least: int) -> Labels:
    """Return the newest labels; ``at_least`` is a version known to exist even if a listing does not show it."""
    for _ in range(TRIES):
        newest = max([at_least, *_versions(store, campaign_id)])
        if newest == 0:
            return Labels()
        document = store.read_json(campaign_id, labels_name(newest), LARGEST_LABELS)
        if document is not None:
            return _parsed(store, campaign_id, newest, document)
        at_least = 0  # it was removed, either with its campaign or because there are many newer ones
    raise StoreError(f"store {store.url}: the labels of {campaign_id} change faster than they are read; try again")


def _prune(store: Store, campaign_id: str, written: int) -> bool:
    """Remove old documents; return False if the document just written counts as old itself.

    In that case its number was free only because a document of that number had been pruned, and the change does not
    take the changes of others since then into account.
    """
    versions = _versions(store, campaign_id)
    for version in versions:
        if version <= max(versions[-1], written) - KEPT:
            store.remove(campaign_id, labels_name(version))
    return not versions or written > versions[-1] - KEPT


def _parsed(store: Store, campaign_id: str, version: int, document: dict[str, Any]) -> Labels:
    """Return the labels in a document; StoreError if it was not written by clearcap."""
    try:
        return Labels.from_document(document, version)
    except ValueError as error:
        raise StoreError(
            f"store {store.url}: {campaign_id}/{labels_name(version)} is not what clearcap wrote ({error}); restore or"
            " remove it"
        ) from error
