"""Drafts of mechanisms from STEP files, saved in a store for all its users; each change is saved as a new version."""

import re
import time
from dataclasses import asdict, dataclass, fields
from hashlib import sha256

from campaign.errors import SpecError, StoreError
from campaign.store.mechanism_library import (
    FOLDER,
    LARGEST_DOCUMENT,
    LARGEST_TEXT,
    NAME,
    StaleMechanism,
    newest_versions,
)
from campaign.store.store import Store

LARGEST_STEP = 32 * 2**20  # bytes of a STEP file
LARGEST_PAGE = 64 * 2**20  # bytes of the page of what was found in it
_FILE = re.compile(rf"({NAME.pattern})\.draft\.(\d{{6}})\.json")
_DIGEST = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Draft:
    """A mechanism file that refers to faces of a STEP file, which may still ask questions."""

    name: str
    step: str  # SHA-256 of the STEP file
    file: str  # the STEP file's name, as it was uploaded
    text: str  # content of the mechanism file
    campaign: str  # content of the campaign file of its limits of size; empty if it has none
    by: str  # who saved it
    version: int = 0  # from 1 once it is saved
    at: float = 0.0  # [s since 1970]

    @property
    def step_file(self) -> str:
        """The name by which the text refers to the STEP file."""
        return f"{self.name}-{self.step[:8]}.step"


def drafts(store: Store) -> dict[str, int]:
    """Return the newest version of each draft, by name."""
    return newest_versions(store, _FILE)


def read_draft(store: Store, name: str) -> Draft | None:
    """Return the newest version of a draft; None if there is none."""
    version = drafts(store).get(name) if NAME.fullmatch(name) else None
    if version is None:
        return None
    file = f"{name}.draft.{version:06d}.json"
    document = store.read_json(FOLDER, file, LARGEST_DOCUMENT)
    texts = [each.name for each in fields(Draft) if each.type is str]
    if (
        document is None
        or not all(isinstance(document.get(key), str) for key in texts)
        or not isinstance(document.get("at"), int | float)
        or not _DIGEST.fullmatch(document["step"])
    ):
        raise StoreError(f"store {store.url}: {FOLDER}/{file} is not what clearcap wrote; restore or remove it")
    return Draft(**{key: document[key] for key in texts} | {"name": name, "version": version, "at": document["at"]})


def save_draft(store: Store, draft: Draft) -> Draft:
    """Save a draft as the version after its own; raise StaleMechanism if somebody else has saved that meanwhile."""
    if not NAME.fullmatch(draft.name):
        words = "not allowed; allowed: 1 to 64 letters, digits, _ and -, no - or _ first"
        raise SpecError(f"name {draft.name!r:.100}: {words}")
    if len(draft.text.encode(errors="replace")) > LARGEST_TEXT:
        raise SpecError(f"draft {draft.name}: has more than {LARGEST_TEXT} bytes")
    content = asdict(draft) | {"version": draft.version + 1, "at": time.time()}
    if drafts(store).get(draft.name, 0) != draft.version or not store.create_json(
        FOLDER, f"{draft.name}.draft.{draft.version + 1:06d}.json", content
    ):
        raise StaleMechanism(
            f"draft {draft.name}: somebody else has saved it meanwhile; look at it and save yours again"
        )
    return Draft(**content)


def save_step(store: Store, content: bytes) -> str:
    """Save a STEP file and return its SHA-256; the same content is saved once."""
    digest = sha256(content).hexdigest()
    store.files.create(f"{FOLDER}/{digest}.step", content)
    return digest


def read_step(store: Store, digest: str) -> bytes:
    """Return the content of a STEP file; StoreError if it is not there, or another one."""
    try:
        content = store.files.read(f"{FOLDER}/{digest}.step", LARGEST_STEP)
    except FileNotFoundError:
        content = b""
    if sha256(content).hexdigest() != digest:
        raise StoreError(
            f"store {store.url}: {FOLDER}/{digest}.step is not what was uploaded; upload the STEP file again"
        )
    return content


def save_page(store: Store, name: str, page: bytes) -> None:
    """Save the page of what was found in the STEP file of a draft, in place of an earlier one."""
    store.files.write(f"{FOLDER}/{name}.page.html", page)


def read_page(store: Store, name: str) -> bytes:
    """Return the page of what was found in the STEP file of a draft; FileNotFoundError if there is none."""
    return store.files.read(f"{FOLDER}/{name}.page.html", LARGEST_PAGE)
