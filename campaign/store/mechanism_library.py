"""Mechanisms saved in a store for all its users; each change is saved as a new version."""

import re
import time
from dataclasses import dataclass
from typing import Any

from campaign.errors import CampaignError, SpecError, StoreError
from campaign.store.store import Store

FOLDER = "mechanisms"
LARGEST_TEXT = 2**20  # bytes of a mechanism's file
LARGEST_DOCUMENT = 8 * LARGEST_TEXT  # as JSON, with all characters escaped
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_FILE = re.compile(r"([A-Za-z0-9][A-Za-z0-9_-]{0,63})\.(\d{6})\.json")


class StaleMechanism(CampaignError):
    """Somebody else saved the mechanism after it was read."""


@dataclass(frozen=True)
class SavedMechanism:
    """One version of a saved mechanism."""

    name: str
    version: int  # from 1
    text: str  # content of its TOML file
    by: str  # who saved it
    at: float  # [s since 1970]


def saved_mechanisms(store: Store) -> dict[str, int]:
    """Return the newest version of each saved mechanism, by name."""
    return newest_versions(store, _FILE)


def newest_versions(store: Store, file: re.Pattern[str]) -> dict[str, int]:
    """Return the newest version by name, of the files whose names match: first group the name, second the version."""
    newest: dict[str, int] = {}
    for match in filter(None, map(file.fullmatch, store.files.names(FOLDER))):
        newest[match[1]] = max(newest.get(match[1], 0), int(match[2]))
    return dict(sorted(newest.items()))


def read_mechanism(store: Store, name: str, version: int | None = None) -> SavedMechanism | None:
    """Return a version of a mechanism, by default the newest; None if it does not exist."""
    if not NAME.fullmatch(name):
        return None
    wanted = saved_mechanisms(store).get(name) if version is None else version
    if wanted is None or not 0 < wanted < 10**6:
        return None
    document = store.read_json(FOLDER, _file(name, wanted), LARGEST_DOCUMENT)
    return None if document is None else _parsed(store, name, wanted, document)


def save_mechanism(store: Store, name: str, text: str, by: str, version: int | None = None) -> SavedMechanism:
    """Save a mechanism's file, which is not checked here, as a new version; earlier ones stay."""
    # `version` is the newest one that its author has seen, 0 for none; StaleMechanism if there is a later one by now.
    if not NAME.fullmatch(name):
        raise SpecError(f"name {name!r:.100}: not allowed; allowed: 1 to 64 letters, digits, _ and -, no - or _ first")
    if len(text.encode(errors="replace")) > LARGEST_TEXT:
        raise SpecError(f"mechanism {name}: has more than {LARGEST_TEXT} bytes")
    newest = saved_mechanisms(store).get(name, 0)
    if version is not None and newest != version:
        raise StaleMechanism(f"mechanism {name}: somebody has saved version {newest}; look at it and save yours again")
    saved = SavedMechanism(name, newest + 1, text, by, time.time())
    document = {"text": text, "by": by, "time": saved.at}
    if not store.create_json(FOLDER, _file(name, saved.version), document):
        raise StaleMechanism(f"mechanism {name}: somebody else saved it at the same time; save yours again")
    return saved


def _file(name: str, version: int) -> str:
    return f"{name}.{version:06d}.json"


def _parsed(store: Store, name: str, version: int, document: dict[str, Any]) -> SavedMechanism:
    """Return the mechanism in a document; StoreError if it was not written by clearcap."""
    text, by, at = (document.get(key) for key in ("text", "by", "time"))
    if not (isinstance(text, str) and isinstance(by, str) and isinstance(at, int | float)):
        raise StoreError(
            f"store {store.url}: {FOLDER}/{_file(name, version)} is not what clearcap wrote; restore or remove it"
        )
    return SavedMechanism(name, version, text, by, float(at))
