"""Files behind a URL that fsspec opens, such as an object store: one PUT writes one file whole."""

import errno
import secrets
import time
from collections.abc import Callable
from typing import Any, TypeVar

import fsspec

PAUSES = (0.5, 1.0, 2.0)  # s, before each repetition; s3fs and botocore repeat on their own before
FINAL = (  # errors that would be the same if the request were repeated
    FileNotFoundError,
    FileExistsError,
    IsADirectoryError,
    NotADirectoryError,
    PermissionError,
    NotImplementedError,
    ValueError,
    TypeError,
    AttributeError,
)

T = TypeVar("T")


class ObjectStore:
    """Files under a URL. Paths are those of the file system; errors are OSError whatever the file system raised.

    What may be a passing fault (a timeout, a server error, "slow down") is tried four times.

    Parameters
    ----------
    url : str
        An fsspec URL.
    """

    def __init__(self, url: str) -> None:
        self.fs, root = fsspec.url_to_fs(url, use_listings_cache=False)
        self.root = str(root).rstrip("/")
        protocols = {self.fs.protocol} if isinstance(self.fs.protocol, str) else set(self.fs.protocol)
        self.shared = "memory" not in protocols

    def path(self, name: str) -> str:
        """Return the full path of a name; the root's own for an empty one."""
        return f"{self.root}/{name}" if name else self.root

    def address(self, path: str) -> str:
        """Return the URL of a file."""
        return str(self.fs.unstrip_protocol(path))

    def probe(self) -> None:
        """Write and remove a file."""
        probe = self.path(f"probe-{secrets.token_hex(4)}.tmp")
        self.write(probe, b"x")
        self.remove(probe)

    def read(self, path: str) -> bytes:
        """Return a file's content."""
        return bytes(_retry(lambda: self.fs.cat_file(path)))

    def size(self, path: str) -> int:
        """Return a file's size in bytes."""
        self.fs.invalidate_cache()
        entry = _retry(lambda: self.fs.info(path))
        if entry["type"] != "file":
            raise FileNotFoundError(path)
        return int(entry["size"])

    def names(self, path: str) -> list[str]:
        """Return the names in a folder, sorted."""
        return sorted(_name(entry) for entry in self._entries(path))

    def sizes(self, path: str) -> dict[str, int]:
        """Return the size of each file in a folder."""
        return {_name(entry): int(entry["size"]) for entry in self._entries(path) if entry["type"] == "file"}

    def write(self, path: str, content: bytes) -> None:
        """Put a file."""
        _retry(lambda: self.fs.pipe_file(path, content))

    def create(self, path: str, content: bytes) -> bool:
        """Put a file unless it exists; return whether it was written.

        The server decides (on S3 by ``If-None-Match``). A server that cannot is first asked whether the file exists:
        then two writers at the same moment may both get True.
        """
        try:
            _retry(lambda: self.fs.pipe_file(path, content, mode="create"))
        except FileExistsError:
            # the answer to our own PUT may have been lost, and the PUT repeated
            return self.read(path) == content
        except (NotImplementedError, ValueError):
            if _retry(lambda: self.fs.exists(path)):
                return False
            self.write(path, content)
        return True

    def move(self, path: str, new: str) -> None:
        """Copy a file, then remove it."""
        _retry(lambda: self.fs.cp_file(path, new))
        self.remove(path)

    def remove(self, path: str) -> None:
        """Remove a file."""
        try:
            _retry(lambda: self.fs.rm_file(path))
        except FileNotFoundError:
            return

    def sweep(self, path: str, ending: str, dead_after: float) -> None:
        """Do nothing: a PUT that does not finish leaves no file."""

    def _entries(self, path: str) -> list[dict[str, Any]]:
        """Return what the file system lists in a folder."""
        self.fs.invalidate_cache()
        try:
            return list(_retry(lambda: self.fs.ls(path, detail=True)))
        except (FileNotFoundError, NotADirectoryError):
            return []


def _retry(action: Callable[[], T]) -> T:
    """Return the result of an action, repeating it after passing faults.

    Raises
    ------
    OSError
        If it fails four times. Errors in `FINAL` are raised at once.
    """
    for pause in (*PAUSES, None):
        try:
            return action()
        except FINAL:
            raise
        except Exception as error:  # every file system has its own errors
            if isinstance(error, OSError) and error.errno == errno.ENOSYS:
                raise NotImplementedError(str(error)) from error
            if pause is None:
                raise OSError(f"{error or type(error).__name__}, {len(PAUSES) + 1} times") from error
            time.sleep(pause)
    raise AssertionError


def _name(entry: dict[str, Any]) -> str:
    """Return the name of an entry within its folder."""
    return str(entry["name"]).rstrip("/").rsplit("/", 1)[-1]
