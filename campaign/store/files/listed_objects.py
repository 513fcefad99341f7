"""Files behind a URL with one folder listed in advance, so that the server is not asked again which files exist."""

from collections.abc import Mapping

from campaign.store.files.object_store import ObjectStore


class ListedObjects(ObjectStore):
    """Files under a URL for reading; the content of one folder is taken from an earlier listing.

    Reading a file that was removed since the listing raises FileNotFoundError, as usual.

    The folder is given by its full path; `sizes` has the size of each file below it, by its name relative to it.
    """

    def __init__(self, store: ObjectStore, folder: str, sizes: Mapping[str, int]) -> None:
        vars(self).update(vars(store))  # the same connection
        self._start, self._listed = f"{folder.rstrip('/')}/", sizes

    def read(self, path: str, at_most: int) -> bytes:
        """Return a file's content; FileNotFoundError without a request if it was not listed."""
        if path.startswith(self._start) and path.removeprefix(self._start) not in self._listed:
            raise FileNotFoundError(path)
        return super().read(path, at_most)

    def size(self, path: str) -> int:
        """Return a file's size in bytes from the listing."""
        if not path.startswith(self._start):
            return super().size(path)
        try:
            return self._listed[path.removeprefix(self._start)]
        except KeyError:
            raise FileNotFoundError(path) from None

    def names(self, path: str) -> list[str]:
        """Return the names in a folder from the listing, sorted."""
        below = self._below(path)
        return super().names(path) if below is None else sorted({name.partition("/")[0] for name in below})

    def sizes(self, path: str) -> dict[str, int]:
        """Return the size of each file in a folder from the listing."""
        below = self._below(path)
        return super().sizes(path) if below is None else {n: size for n, size in below.items() if "/" not in n}

    def _below(self, path: str) -> dict[str, int] | None:
        """Return the sizes of the files below a folder by their names relative to it; None if it was not listed."""
        start = f"{path.rstrip('/')}/"
        if not start.startswith(self._start):
            return None
        inner = start.removeprefix(self._start)
        return {name.removeprefix(inner): size for name, size in self._listed.items() if name.startswith(inner)}
