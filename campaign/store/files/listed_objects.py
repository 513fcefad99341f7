"""Files behind a URL, of which a folder was listed once: nobody asks the server again which of them exist."""

from collections.abc import Mapping

from campaign.store.files.object_store import ObjectStore


class ListedObjects(ObjectStore):
    """Files under a URL, to be read; what is below the folder is taken to be as it was when it was listed.

    A file that was removed since is not found when it is read, as anywhere else.

    Parameters
    ----------
    store : ObjectStore
        The files.
    folder : str
        Full path of the folder.
    sizes : dict of str to int
        Size of each file below the folder, by its name relative to the folder.
    """

    def __init__(self, store: ObjectStore, folder: str, sizes: Mapping[str, int]) -> None:
        vars(self).update(vars(store))  # the same connection
        self._start, self._listed = f"{folder.rstrip('/')}/", sizes

    def read(self, path: str, at_most: int) -> bytes:
        """Return a file's content; one that was not listed is not asked for."""
        if path.startswith(self._start) and path.removeprefix(self._start) not in self._listed:
            raise FileNotFoundError(path)
        return super().read(path, at_most)

    def size(self, path: str) -> int:
        """Return a file's size in bytes, as it was listed."""
        if not path.startswith(self._start):
            return super().size(path)
        try:
            return self._listed[path.removeprefix(self._start)]
        except KeyError:
            raise FileNotFoundError(path) from None

    def names(self, path: str) -> list[str]:
        """Return the names in a folder, sorted, as they were listed."""
        below = self._below(path)
        return super().names(path) if below is None else sorted({name.partition("/")[0] for name in below})

    def sizes(self, path: str) -> dict[str, int]:
        """Return the size of each file in a folder, as it was listed."""
        below = self._below(path)
        return super().sizes(path) if below is None else {n: size for n, size in below.items() if "/" not in n}

    def _below(self, path: str) -> dict[str, int] | None:
        """Return the sizes of the files below a folder, by their names relative to it; None if it was not listed."""
        start = f"{path.rstrip('/')}/"
        if not start.startswith(self._start):
            return None
        inner = start.removeprefix(self._start)
        return {name.removeprefix(inner): size for name, size in self._listed.items() if name.startswith(inner)}
