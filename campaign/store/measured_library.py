"""Measured parts in a store, for all its users: each table with its limits, its report, and who sent it when."""

import re
from functools import lru_cache
from hashlib import sha256

from pydantic import BaseModel, Field, ValidationError

from campaign.errors import CampaignError, StoreError
from campaign.store.store import Store

FOLDER = "measured"
LARGEST_PARTS = 32 * 2**20  # bytes of a table
LARGEST_RECORD = 2**18  # bytes
MOST_TABLES = 10_000  # in a store
NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,99}$"
_RECORD = re.compile(r"([A-Za-z0-9][A-Za-z0-9_-]{0,99})\.json")


class MeasuredParts(BaseModel):
    """A table of measured parts, and what its report says."""

    id: str = Field(pattern=NAME, description="Of table and limits", examples=["lever-0a1b2c3d4e"])
    file: str = Field(description="Name of the table", examples=["lever.csv"])
    table: str = Field(description="SHA-256 of the table")
    limits: str = Field(description="SHA-256 of the limits")
    title: str = Field(examples=["Lever 4711, lots of November"])
    parts: int = Field(examples=[200])
    headline: str
    verdicts: dict[str, str] = Field(description="By characteristic", examples=[{"diameter": "capable"}])
    by: str = Field(description="Who sent it", examples=["eva"])
    at: float = Field(description="When it was sent, seconds since 1970", examples=[1795424400.0])


def id_of_parts(file: str, table: str, limits: str) -> str:
    """Return the id of a table from its file's name, and the digests of table and limits."""
    stem = re.sub(r"[^A-Za-z0-9]+", "-", file.rpartition(".")[0]).strip("-")[:60]
    return f"{stem or 'parts'}-{sha256(f'{table} {limits}'.encode()).hexdigest()[:10]}"


def measured_parts(store: Store) -> list[MeasuredParts]:
    """Return all tables, the newest first."""
    stamps = store.files.stamps(FOLDER)
    found = [_read(store, match[1], stamps[match[0]]) for match in filter(None, map(_RECORD.fullmatch, stamps))]
    return sorted(filter(None, found), key=place, reverse=True)


def place(each: MeasuredParts) -> tuple[float, str]:
    """Return where a table is in the list of all."""
    return each.at, each.id


@lru_cache(maxsize=MOST_TABLES)
def _read(store: Store, name: str, _stamp: str) -> MeasuredParts | None:
    """Return a table's record; what is read once is read again only if its file has changed."""
    return read_parts_record(store, name)


def read_parts_record(store: Store, name: str) -> MeasuredParts | None:
    """Return the record of a table; None if there is none."""
    document = store.read_json(FOLDER, f"{name}.json", LARGEST_RECORD) if re.fullmatch(NAME, name) else None
    if document is None:
        return None
    try:
        return MeasuredParts.model_validate({**document, "id": name})
    except ValidationError as error:
        words = f"{FOLDER}/{name}.json is not what clearcap wrote; restore or remove it"
        raise StoreError(f"store {store.url}: {words}") from error


def save_parts(store: Store, parts: MeasuredParts, files: dict[str, bytes]) -> MeasuredParts:
    """Save a table with the files of its report; of one that is there already, return what is there."""
    if sum(map(bool, map(_RECORD.fullmatch, store.files.names(FOLDER)))) >= MOST_TABLES:
        raise CampaignError(f"the store has {MOST_TABLES} tables of measured parts, the most allowed; delete old ones")
    for name, content in files.items():
        store.files.write(f"{FOLDER}/{parts.id}/{name}", content)
    # last: from here on it is listed
    is_new = store.create_json(FOLDER, f"{parts.id}.json", parts.model_dump())
    return parts if is_new else read_parts_record(store, parts.id) or parts


def remove_parts(store: Store, name: str) -> None:
    """Remove a table with its report."""
    store.remove(FOLDER, f"{name}.json")
    store.files.remove_tree(f"{FOLDER}/{name}")
