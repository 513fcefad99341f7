"""Files behind a URL that fsspec opens, such as an object store: one PUT writes one file whole."""

import errno
import secrets
import threading
from contextlib import suppress
from typing import Any

import fsspec
from fsspec.core import split_protocol

from engine.regular_file import UnfitFile

FINAL = (  # errors that would be the same if the request were repeated
    FileNotFoundError,
    FileExistsError,
    IsADirectoryError,
    NotADirectoryError,
    NotImplementedError,
    ValueError,
    TypeError,
    AttributeError,
    ImportError,
)
STAMPED = ("size", "ETag", "LastModified", "mtime", "modify", "created", "md5")  # what file systems say of a file


class ObjectStore:
    """Files under a URL. Paths are those of the file system, and so are errors.

    The file system is opened at the first use. One that works over a connection of its own (FTP, SFTP) is opened once
    in each thread, because two threads cannot talk over one connection.

    Parameters
    ----------
    url : str
        An fsspec URL, with its secrets.

    Raises
    ------
    ValueError, ImportError
        If no file system of this name is installed.
    """

    faults = Exception  # every file system has its own errors

    def __init__(self, url: str) -> None:
        self._url = url
        self._opened = threading.local()
        self._shared: tuple[Any, str] | None = None
        self._made: set[str] = set()
        protocols = [split_protocol(link)[0] or link for link in url.split("::") if "://" in link or link.isalnum()]
        for protocol in protocols:
            fsspec.get_filesystem_class(protocol)
        self.shared = "memory" not in protocols

    def path(self, name: str) -> str:
        """Return the full path of a name; the root's own for an empty one."""
        root = self._open()[1]
        return f"{root}/{name}" if name else root

    def is_final(self, error: Exception) -> bool:
        """Return whether an operation that failed like this would fail again."""
        return isinstance(error, FINAL)

    def reopen(self) -> None:
        """Forget the connection of this thread, which may be what is broken."""
        self._opened = threading.local()

    def probe(self) -> None:
        """Write and remove a file."""
        probe = self.path(f"probe-{secrets.token_hex(4)}.tmp")
        self.write(probe, b"x")
        self.remove(probe)

    def read(self, path: str, at_most: int) -> bytes:
        """Return a file's content; UnfitFile if it has more bytes."""
        try:
            content = bytes(self._fs.cat_file(path))
        except FileNotFoundError:
            if self._exists(path):  # over FTP every fault has this name
                raise OSError(errno.EIO, "it is there, but was not sent") from None
            raise
        if len(content) > at_most:
            raise UnfitFile(errno.EFBIG, f"has {len(content)} bytes; allowed: up to {at_most}", path)
        return content

    def size(self, path: str) -> int:
        """Return a file's size in bytes."""
        self._fs.invalidate_cache()
        entry = self._fs.info(path)
        if entry["type"] != "file":
            raise FileNotFoundError(path)
        return int(entry["size"])

    def names(self, path: str) -> list[str]:
        """Return the names in a folder, sorted."""
        return sorted(_name(entry) for entry in self._entries(path))

    def sizes(self, path: str) -> dict[str, int]:
        """Return the size of each file in a folder."""
        return {_name(entry): int(entry["size"]) for entry in self._entries(path) if entry["type"] == "file"}

    def stamps(self, path: str) -> dict[str, str]:
        """Return a stamp of each file below a folder, by its name relative to the folder; on S3 from one listing."""
        found = self._found(path)
        return {name: " ".join(str(entry.get(key, "")) for key in STAMPED) for name, entry in found.items()}

    def sizes_below(self, path: str) -> dict[str, int]:
        """Return the size of each file below a folder, by its name relative to the folder; on S3 from one listing."""
        return {name: int(entry["size"]) for name, entry in self._found(path).items()}

    def _found(self, path: str) -> dict[str, dict[str, Any]]:
        """Return what the file system says of each file below a folder, by its name relative to the folder."""
        self._fs.invalidate_cache()
        try:
            found = self._fs.find(path, detail=True)
        except (FileNotFoundError, NotADirectoryError):
            return {}
        start = len(path.rstrip("/")) + 1
        return {name[start:]: entry for name, entry in found.items()}

    def write(self, path: str, content: bytes) -> None:
        """Put a file."""
        self._put(path, content)

    def create(self, path: str, content: bytes) -> bool:
        """Put a file unless it exists; return whether it was written.

        The server decides (on S3 by ``If-None-Match``). A server that cannot is first asked whether the file exists:
        then two writers at the same moment may both get True.
        """
        try:
            self._put(path, content, mode="create")
        except FileExistsError:
            return False
        except (NotImplementedError, ValueError, OSError) as error:
            if isinstance(error, OSError) and error.errno != errno.ENOSYS:
                raise
            if self._exists(path):
                return False
            self.write(path, content)
        return True

    def move(self, path: str, new: str) -> None:
        """Rename a file; on an object store, which cannot, copy it and remove it."""
        if not self._fs.async_impl:
            self._fs.mv(path, new)
            return
        self._fs.cp_file(path, new)
        self.remove(path)

    def remove(self, path: str) -> None:
        """Remove a file."""
        try:
            self._fs.rm_file(path)
        except Exception:  # every file system has its own error for a file that is not there
            if self._exists(path):
                raise

    def remove_tree(self, path: str) -> None:
        """Remove a file, or all files whose names begin with a folder."""
        with suppress(FileNotFoundError):
            self._fs.rm(path, recursive=True)

    def sweep(self, path: str, ending: str, dead_after: float) -> None:
        """Do nothing: a PUT that does not finish leaves no file."""

    @property
    def _fs(self) -> Any:
        """The file system."""
        return self._open()[0]

    def _open(self) -> tuple[Any, str]:
        """Return the file system and the root in it."""
        opened: tuple[Any, str] | None = self._shared or getattr(self._opened, "pair", None)
        if opened is None:
            fs, root = fsspec.url_to_fs(self._url, use_listings_cache=False)
            if hasattr(fs, "max_concurrency"):
                fs.max_concurrency = 1  # s3fs asks for the size before it reads, to read large files in pieces at once
            opened = fs, str(root).rstrip("/")
            if fs.async_impl:
                self._shared = opened
            else:
                self._opened.pair = opened
        return opened

    def _exists(self, path: str) -> bool:
        """Return whether there is such a file; a fault is raised, where fsspec's own `exists` says no."""
        try:
            self.size(path)
        except FileNotFoundError:
            return False
        return True

    def _put(self, path: str, content: bytes, **how: Any) -> None:
        """Put a file; where there are true folders, make its own first if that was why it failed."""
        try:
            self._fs.pipe_file(path, content, **how)
        except FileExistsError:
            raise
        except Exception:
            folder = path.rpartition("/")[0]
            if self._fs.async_impl or folder in self._made:
                raise
            self._fs.makedirs(folder, exist_ok=True)
            self._made.add(folder)
            self._fs.pipe_file(path, content, **how)

    def _entries(self, path: str) -> list[dict[str, Any]]:
        """Return what the file system lists in a folder."""
        self._fs.invalidate_cache()
        try:
            return list(self._fs.ls(path, detail=True))
        except (FileNotFoundError, NotADirectoryError):
            return []


def _name(entry: dict[str, Any]) -> str:
    """Return the name of an entry within its folder."""
    return str(entry["name"]).rstrip("/").rsplit("/", 1)[-1]
