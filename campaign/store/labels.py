"""Labels of a campaign: its owner, tags, a note, and whether it is archived.

They do not affect what is computed: neither the id nor any row depends on them. `campaign.store.label_versions` keeps
them in the store.
"""

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from campaign.errors import SpecError

FORMAT = 1
LONGEST_OWNER, LONGEST_TAG, LONGEST_NOTE = 100, 40, 2000  # characters
MOST_TAGS = 20
_TAG = re.compile(rf"[^\W_][\w.:/+-]{{0,{LONGEST_TAG - 1}}}")
_HIDDEN = {"Cc", "Cf", "Cs", "Zl", "Zp"}  # categories of characters that are invisible or reorder others


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
    """A change of labels; anything that is None or not named stays as it is.

    Raises SpecError if a text is too long or contains characters that are not allowed.
    """

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


def _owner(text: Any) -> str:
    return _plain("owner", text, LONGEST_OWNER)


def _note(text: Any) -> str:
    return _plain("note", text, LONGEST_NOTE, keep="\n\t")


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
