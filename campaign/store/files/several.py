"""Several files read at a time, because an object store answers slowly."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from campaign.errors import StoreError
from campaign.store.files.files import Files

READERS = 8  # files read at a time

T = TypeVar("T")


def read_several(files: Files, names: Sequence[str], read: Callable[[Files, str], T]) -> Iterator[tuple[str, T | None]]:
    """Yield each name, in order, and what ``read`` makes of its file, which is tried once; None if the store fails."""

    # A pool cannot be left before its threads end, so they try once. If the store fails, only the caller waits for it,
    # so that Ctrl-C ends the waiting.
    def try_one(name: str) -> T | None:
        try:
            return read(files.hasty, name)
        except StoreError:
            return None

    with ThreadPoolExecutor(READERS) as pool:
        yield from zip(names, pool.map(try_one, names), strict=True)


def content(files: Files, name: str) -> bytes:
    """Return the content of a file; empty if there is none."""
    try:
        return files.read(name)
    except FileNotFoundError:
        return b""
