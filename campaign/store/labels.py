"""Labels of a campaign: its owner, tags, a note, and whether it is archived; and their versions in the store.

They do not affect what is computed: neither the id nor any row depends on them.
"""

import re
import time
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from campaign.errors import CampaignError, SpecError, StoreError
from campaign.store.layout import PLAN, labels_name
from campaign.store.store import Store

FORMAT = 1
LONGEST_OWNER, LONGEST_TAG, LONGEST_NOTE = 100, 40, 2000  # characters
MOST_TAGS = 20
_TAG = re.compile(rf"[^\W_][\w.:/+-]{{0,{LONGEST_TAG - 1}}}")
_HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}  # categories of characters that are invisible or reorder others
LARGEST_LABELS = 2**14  # bytes of a document; labels at their limits fit, with four bytes per character
KEPT = 20  # documents of a campaign; older ones are removed
TRIES = 20  # while others change the same labels at the same time
_NAME = re.compile(r"labels-(\d{6})\.json")


@dataclass(frozen=True)
class Labels:
    """The labels that people give a campaign."""

    owner: str = ""  # the person responsible for it; empty if there is none
    tags: tuple[str, ...] = ()  # in alphabetical order
    note: str = ""  # any number of lines
    archived: bool = False  # whether lists leave the campaign out by default
    version: int = 0  # number of the last change; 0 if there was none
    changed_by: str = ""  # author of the last change
    changed_at: float = 0.0  # [s since 1970]

    def to_json(self) -> dict[str, Any]:
        """Return owner, tags, note, archived and version as plain data."""
        shown = {"owner": self.owner, "tags": list(self.tags), "note": self.note}
        return {**shown, "archived": self.archived, "version": self.version}

    def document(self) -> dict[str, Any]:
        """Return the document to write into the store."""
        return {"format": FORMAT, **self.to_json(), "by": self.changed_by, "time": self.changed_at}

    @classmethod
    def from_document(cls, document: dict[str, Any], version: int) -> "Labels":
        """Return the labels in a document; ValueError if it does not have the form that `document` returns."""
        try:
            tags, at = document["tags"], float(document["time"])
            labels = cls(
                _owner(document["owner"]),
                tuple(map(_tag, tags)) if isinstance(tags, list) else (),
                _note(document["note"]),
                document["archived"] is True,
                version,
                str(document["by"]),
                at,
            )
        except (SpecError, KeyError, TypeError, OverflowError) as error:
            raise ValueError(f"it lacks {error}" if isinstance(error, KeyError) else str(error)) from error
        if document["format"] != FORMAT or len(labels.tags) > MOST_TAGS:
            raise ValueError(f"it has format {document['format']!r:.20} and {len(labels.tags)} tags")
        return labels

    def has(self, owner: str | None, tags: Iterable[str]) -> bool:
        """Return whether the labels have this owner, if one is given, and all these tags."""
        return owner in (None, self.owner) and set(tags) <= set(self.tags)


@dataclass(frozen=True)
class LabelChange:
    """A change of labels; what is None or not named stays. SpecError if a text is too long or has hidden characters."""

    owner: str | None = None  # empty to remove it
    add: tuple[str, ...] = ()
    remove: tuple[str, ...] = ()
    note: str | None = None  # empty to remove it
    archived: bool | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "owner", None if self.owner is None else _owner(self.owner))
        object.__setattr__(self, "note", None if self.note is None else _note(self.note))
        object.__setattr__(self, "add", tuple(map(_tag, self.add)))
        object.__setattr__(self, "remove", tuple(map(_tag, self.remove)))

    def applied(self, labels: Labels) -> Labels:
        """Return labels with this change applied; SpecError if they would have too many tags."""
        tags = tuple(sorted({*labels.tags, *self.add} - set(self.remove)))
        if len(tags) > MOST_TAGS:
            raise SpecError(f"tags: there would be {len(tags)}; allowed: up to {MOST_TAGS}; remove some")
        return replace(
            labels,
            owner=labels.owner if self.owner is None else self.owner,
            tags=tags,
            note=labels.note if self.note is None else self.note,
            archived=labels.archived if self.archived is None else self.archived,
        )


def is_owner(name: str) -> bool:
    """Return whether this is a valid name of an owner."""
    try:
        return bool(_owner(name))
    except SpecError:
        return False


def _tag(text: Any) -> str:
    tag = _plain("tag", text, LONGEST_TAG)
    if not _TAG.fullmatch(tag):
        raise SpecError(
            f"tag {tag!r}: not allowed; a tag has letters, digits and _ . : / + -, no spaces, and begins with a letter"
            " or a digit"
        )
    return tag


def _plain(what: str, text: Any, longest: int, keep: str = "") -> str:
    """Return a text in Unicode form NFC, stripped; SpecError if it is too long or contains hidden characters."""
    if not isinstance(text, str):
        raise SpecError(f"{what}: {text!r:.40} is not text")
    normal = unicodedata.normalize("NFC", text).strip()
    if len(normal) > longest:
        raise SpecError(f"{what}: has {len(normal)} characters; allowed: up to {longest}")
    hidden = [char for char in normal if unicodedata.category(char) in _HIDDEN and char not in keep]
    if hidden:
        raise SpecError(f"{what}: has the hidden character U+{ord(hidden[0]):04X}; leave it out")
    return normal


_owner = partial(_plain, "owner", longest=LONGEST_OWNER)
_note = partial(_plain, "note", longest=LONGEST_NOTE, keep="\n\t")


# -- versions in the store ---------------------------------------------------------------------------------------------
#
# No change is lost if several people change labels at the same time. Each change writes a new document,
# ``labels-000001.json`` and so on, which must not exist yet. If two people change the same labels at once, one is
# first; the other change is applied to the new labels, or refused. So no change overwrites another unseen, even on
# shared folders without locks. Campaigns of earlier versions have no labels.


class StaleLabels(CampaignError):
    """Somebody else changed the labels of a campaign after they were read."""


def read_labels(store: Store, campaign_id: str) -> Labels:
    """Return the labels of a campaign; empty ones of version 0 if it has none."""
    return _newest(store, campaign_id, 0)


def change_labels(
    store: Store, campaign_id: str, change: LabelChange, *, by: str = "", version: int | None = None
) -> Labels:
    """Change the labels of a campaign, given by its full id, and return the new ones; `by` is who changes them."""
    # StaleLabels if they have another version by now than `version`; None applies the change to the current ones.
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
    """Remove old documents; return False if the document just written counts as old itself."""
    # In that case its number was free only because a document of that number had been pruned, and the change does not
    # take the changes of others since then into account.
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
