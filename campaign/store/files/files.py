"""Files of a store, in a folder or behind any fsspec URL: each is written whole or not at all."""

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from campaign.errors import SpecError, StoreError
from campaign.store.files.local import LocalFolder

if TYPE_CHECKING:
    from campaign.store.files.object_store import ObjectStore

TEMPORARY = ".tmp"  # ending of files that are being written
LARGEST = 256 * 2**20  # bytes read into memory at once: ten times the largest file that a store should hold
LONGEST_NAME = 500  # characters of a name relative to the root
DEAD_AFTER = 3600.0  # s: no write of one file takes this long

T = TypeVar("T")


class Files:
    """Reads and writes under one root.

    Parameters
    ----------
    url : str
        A folder's path, or an fsspec URL.

    Attributes
    ----------
    local : bool
        The root is a folder of this machine, maybe one it shares with others.

    Raises
    ------
    SpecError
        If the URL names no file system that is installed here.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.local = ("://" not in url and "::" not in url) or url.startswith(("file://", "local://"))
        self._backend = LocalFolder(re.sub(r"^(file|local)://", "", url)) if self.local else _open_url(url)

    @property
    def root(self) -> str:
        """The path or URL under which every process finds the same files, whatever its working folder."""
        return self._backend.root if isinstance(self._backend, LocalFolder) else self.url

    @property
    def shared(self) -> bool:
        """Whether other processes see the same files."""
        return self._backend.shared

    def path(self, name: str) -> str:
        """Return the full path of a name relative to the root.

        Raises
        ------
        StoreError
            If the name leads out of the root, or no file can have such a name.
        """
        if (
            len(name) > LONGEST_NAME
            or not name.isprintable()
            or name.startswith(("/", "~"))
            or "\\" in name
            or ".." in name.split("/")
        ):
            shown = name if len(name) <= 60 else name[:57] + "..."
            raise StoreError(
                f"store {self.url}: {shown!r} is not a valid file name; names are relative, without .."
                f" and of at most {LONGEST_NAME} characters"
            )
        return self._backend.path(name)

    def address(self, name: str) -> str:
        """Return the path or URL by which other programs open a file."""
        return self._backend.address(self.path(name))

    def check_writable(self) -> None:
        """Check that files can be written; none is left.

        Raises
        ------
        SpecError
            If they cannot.
        """
        try:
            self._backend.probe()
        except Exception as error:  # every file system has its own errors
            raise SpecError(
                f"store {self.url}: not writable ({_reason(error)}); name a folder you may write to"
            ) from error

    def read(self, name: str, at_most: int = LARGEST) -> bytes:
        """Return a file's content.

        Raises
        ------
        FileNotFoundError
            If it does not exist.
        StoreError
            If it cannot be read, or has more than ``at_most`` bytes.
        """
        size = self.size(name)
        if size > at_most:
            raise StoreError(
                f"store {self.url}: {name} has {size} bytes, more than the {at_most} that a file of a store may"
                " have, so clearcap did not write it; move it away"
            )
        return self._do(self._backend.read, name, "read")

    def size(self, name: str) -> int:
        """Return a file's size in bytes; FileNotFoundError if it does not exist."""
        return self._do(self._backend.size, name, "read")

    def exists(self, name: str) -> bool:
        """Return whether there is such a file."""
        try:
            self.size(name)
        except FileNotFoundError:
            return False
        return True

    def sizes(self, folder: str) -> dict[str, int]:
        """Return the size in bytes of each file in a folder, by name; none if there is no such folder."""
        return self._do(self._backend.sizes, folder, "listed")

    def names(self, folder: str) -> list[str]:
        """Return the names of the files and folders in a folder, sorted; none if there is no such folder."""
        return self._do(self._backend.names, folder, "listed")

    def write(self, name: str, content: bytes) -> None:
        """Write a file whole or not at all, replacing an earlier one."""
        self._do(lambda path: self._backend.write(path, content), name, "written")

    def create(self, name: str, content: bytes) -> bool:
        """Write a file whole or not at all, unless it exists; return whether it was written."""
        return self._do(lambda path: self._backend.create(path, content), name, "written")

    def move(self, old: str, new: str) -> None:
        """Give a file another name; FileNotFoundError if it does not exist.

        Behind a URL it is copied and then removed: if the process is killed between, both exist.
        """
        target = self.path(new)
        self._do(lambda path: self._backend.move(path, target), old, "moved")

    def remove(self, name: str) -> None:
        """Remove a file, if it exists."""
        self._do(lambda path: self._backend.remove(path), name, "removed")

    def sweep(self, folder: str) -> None:
        """Remove the temporary files of dead writers from a folder."""
        self._do(lambda path: self._backend.sweep(path, TEMPORARY, DEAD_AFTER), folder, "swept")

    def _do(self, action: Callable[[str], T], name: str, what: str) -> T:
        """Apply an action to a file; turn the errors of the file system into a StoreError that names a remedy."""
        try:
            return action(self.path(name))
        except (FileNotFoundError, NotADirectoryError) as error:
            if what in ("read", "moved"):
                raise FileNotFoundError(name) from error
            reason: Exception = error
        except OSError as error:
            reason = error
        remedy = "free or repair the disk" if self.local else "check that it exists and can be reached"
        raise StoreError(
            f"store {self.url}: {name or 'its folder'} cannot be {what} ({_reason(reason)});"
            f" {remedy}, then run the same command again"
        ) from reason


def _reason(error: Exception) -> str:
    """Return in words why something failed."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__


def _open_url(url: str) -> "ObjectStore":
    """Open the file system of a URL."""
    from campaign.store.files.object_store import ObjectStore  # imports fsspec, which folders do without

    try:
        return ObjectStore(url)
    except (ValueError, ImportError) as error:
        raise SpecError(f"store {url}: {error}; name a folder, or a URL fsspec can open") from error
