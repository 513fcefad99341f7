"""The version of a campaign's rows, which changes with every new row and is found without reading rows."""

import hashlib

from campaign.errors import StoreError
from campaign.store import Store
from campaign.store.layout import MANIFEST, PARTS, PLAN, STOPPED


def rows_version(store: Store, campaign: str) -> str:
    """Return a digest of all that determines the rows of a campaign: its plan, manifest, files of rows, and end.

    The manifest lists each file with its size and digest. Files that it does not list yet are identified by name and
    size, as in a survey. Merging files changes the version, although the rows stay the same.
    """
    digest = hashlib.sha256()
    for name in (PLAN, MANIFEST, STOPPED):
        try:
            content = store.files.read(f"{campaign}/{name}")
        except FileNotFoundError:
            if name == PLAN:
                raise StoreError(
                    f"store {store.url}: has no campaign {campaign}; see: {store.command('list')}"
                ) from None
            content = b""
        digest.update(hashlib.sha256(content).digest())
    for name, size in sorted(store.files.sizes(f"{campaign}/{PARTS}").items()):
        digest.update(f"{name} {size}\n".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()
