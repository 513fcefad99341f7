"""A version of the rows of a campaign: it changes with every row, and is known without reading rows."""

import hashlib

from campaign.errors import StoreError
from campaign.store import Store
from campaign.store.layout import MANIFEST, PARTS, PLAN, STOPPED


def rows_version(store: Store, campaign: str) -> str:
    """Return a digest of what determines the rows of a campaign: plan, manifest, files of rows, end.

    The manifest names each file with its size and digest. Files that it does not know yet count with name and size, as
    they do for a survey. Merging files changes the version though the rows stay.

    Parameters
    ----------
    store : Store
        Where the campaign is.
    campaign : str
        Its whole id.

    Returns
    -------
    str
        64 hexadecimal digits.

    Raises
    ------
    StoreError
        If the store cannot be read, or has no such campaign.
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
