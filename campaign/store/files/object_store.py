"""Files behind a URL that fsspec opens, such as an object store, where one PUT writes one whole file."""

import errno
import inspect
import secrets
import threading
from collections.abc import Mapping
from contextlib import suppress
from copy import copy
from typing import Any

import fsspec
from fsspec.asyn import sync
from fsspec.core import split_protocol

from engine.platform.regular_file import UnfitFile

FINAL = (  # errors that repeating the request would not change
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
STAMPED = ("size", "ETag", "LastModified", "mtime", "modify", "created", "md5")  # properties that show a change
SLOWEST = 500e3  # bytes/s; the slowest connection to a server that is allowed for
MANY_FILES = 60.0  # s, added for an operation that the server answers in many pieces


class ObjectStore:
    """Files under an fsspec URL with its secrets; ``answer_s`` is how long a server may take, besides the bytes [s]."""

    faults = Exception  # every file system has its own errors

    def __init__(self, url: str, answer_s: float) -> None:
        self._fs = OpenedFileSystem(url)
        self._answer_s = answer_s
        self._made: set[str] = set()
        self.shared = self._fs.shared

    def within(self, answer_s: float) -> "ObjectStore":
        """Return the same files for callers that wait this long for an answer [s]."""
        other = copy(self)
        other._answer_s = answer_s
        return other

    def path(self, name: str) -> str:
        """Return the full path of a name; the path of the root if the name is empty."""
        return f"{self._fs.root}/{name}" if name else self._fs.root

    def is_final(self, error: Exception) -> bool:
        """Return whether an operation that failed like this would fail again."""
        return isinstance(error, FINAL)

    def reopen(self) -> None:
        """Drop the connection of this thread, because it may be broken."""
        self._fs.reopen()

    def probe(self) -> None:
        """Write and remove a file."""
        probe = self.path(f"probe-{secrets.token_hex(4)}.tmp")
        self.write(probe, b"x")
        self.remove(probe)

    def read(self, path: str, at_most: int) -> bytes:
        """Return a file's content; UnfitFile if it has more than ``at_most`` bytes."""
        size = self.size(path)
        # asked before the content, so that nothing larger is transferred
        if size > at_most:
            raise UnfitFile(errno.EFBIG, f"has {size} bytes; allowed: up to {at_most}", path)
        try:
            content = bytes(self._ask("cat_file", path, carried=size))
        except FileNotFoundError:
            if self._exists(path):  # over FTP every fault is reported as a missing file
                raise OSError(errno.EIO, "it is there, but was not sent") from None
            raise
        if len(content) > at_most:  # it grew
            raise UnfitFile(errno.EFBIG, f"has {len(content)} bytes; allowed: up to {at_most}", path)
        return content

    def size(self, path: str) -> int:
        """Return a file's size in bytes."""
        self._fs.forget_listings()
        entry = self._ask("info", path)
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
        """Return a stamp for each file below a folder, by its name relative to the folder; on S3 from one listing."""
        found = self._found(path)
        return {name: " ".join(str(entry.get(key, "")) for key in STAMPED) for name, entry in found.items()}

    def sizes_below(self, path: str) -> dict[str, int]:
        """Return the size of each file below a folder, by its name relative to the folder; on S3 from one listing."""
        return {name: int(entry["size"]) for name, entry in self._found(path).items()}

    def _found(self, path: str) -> dict[str, dict[str, Any]]:
        """Return the file system's entry for each file below a folder, by its name relative to the folder."""
        self._fs.forget_listings()
        try:
            found = self._ask_for_many("find", path, detail=True)
        except (FileNotFoundError, NotADirectoryError):
            return {}
        start = len(path.rstrip("/")) + 1
        return {name[start:]: entry for name, entry in found.items()}

    def write(self, path: str, content: bytes) -> None:
        """Put a file."""
        self._put(path, content)

    def create(self, path: str, content: bytes) -> bool:
        """Put a file unless it exists; return whether it was written."""
        # The server decides (on S3 by ``If-None-Match``). If it cannot, it is first asked whether the file exists; in
        # that case two simultaneous writers may both get True.
        try:
            self._put(path, content, mode="create")
        except FileExistsError:
            return False
        # this file system, or this server, cannot write a file on condition that there is none
        except (NotImplementedError, ValueError, OSError) as error:
            if isinstance(error, OSError) and error.errno != errno.ENOSYS:
                raise
            if self._exists(path):
                return False
            self.write(path, content)
        return True

    def move(self, path: str, new: str) -> None:
        """Rename a file; on an object store, which cannot rename, copy and remove it."""
        if not self._fs.is_async:
            self._ask("mv", path, new)
            return
        self._ask_for_many("cp_file", path, new)
        self.remove(path)

    def remove(self, path: str) -> None:
        """Remove a file."""
        try:
            self._ask("rm_file", path)
        except Exception:  # every file system has its own error for a missing file
            if self._exists(path):
                raise

    def remove_tree(self, path: str) -> None:
        """Remove a file, or all files below a folder."""
        with suppress(FileNotFoundError):
            self._ask_for_many("rm", path, recursive=True)

    def sweep(self, path: str, ending: str, dead_after: float) -> None:
        """Do nothing: a PUT that does not finish leaves no file."""

    def _ask(self, operation: str, *arguments: Any, carried: int = 0, **how: Any) -> Any:
        """Return the answer of the server; ``carried`` is the number of bytes in the request or the answer."""
        return self._fs.ask(operation, *arguments, seconds=self._answer_s + carried / SLOWEST, **how)

    def _ask_for_many(self, operation: str, *arguments: Any, **how: Any) -> Any:
        """Return the answer of the server to an operation that it answers in many pieces."""
        return self._fs.ask(operation, *arguments, seconds=self._answer_s + MANY_FILES, **how)

    def _exists(self, path: str) -> bool:
        """Return whether a file exists; raises faults, whereas fsspec's own `exists` returns False."""
        try:
            self.size(path)
        except FileNotFoundError:
            return False
        return True

    def _put(self, path: str, content: bytes, **how: Any) -> None:
        """Put a file; if that fails on a file system with true folders, make its folder and put it again."""
        try:
            self._ask("pipe_file", path, content, carried=len(content), **how)
        except FileExistsError:
            raise
        except Exception:
            folder = path.rpartition("/")[0]
            # an object store has no folders, and a folder that was made is not the reason
            if self._fs.is_async or folder in self._made:
                raise
            self._ask("makedirs", folder, exist_ok=True)
            self._made.add(folder)
            self._ask("pipe_file", path, content, **how)

    def _entries(self, path: str) -> list[dict[str, Any]]:
        self._fs.forget_listings()
        try:
            return list(self._ask("ls", path, detail=True))
        except (FileNotFoundError, NotADirectoryError):
            return []


def _name(entry: dict[str, Any]) -> str:
    return str(entry["name"]).rstrip("/").rsplit("/", 1)[-1]


class ListedObjects(ObjectStore):
    """Files under a URL for reading; the content of one folder, by its full path, is taken from an earlier listing."""

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


class OpenedFileSystem:
    """The file system of an fsspec URL with its secrets, opened at first use; `shared` with other processes, or not.

    A file system with a connection of its own (FTP, SFTP) is opened once in each thread, because two threads cannot
    share one connection.
    """

    def __init__(self, url: str) -> None:
        self._url = url
        self._opened = threading.local()
        self._for_all_threads: tuple[Any, str] | None = None
        protocols = [split_protocol(link)[0] or link for link in url.split("::") if "://" in link or link.isalnum()]
        for protocol in protocols:
            # opened only later, but what is not installed is reported now
            fsspec.get_filesystem_class(protocol)
        self.shared = "memory" not in protocols

    @property
    def root(self) -> str:
        """Path of the URL in the file system."""
        return self._pair()[1]

    @property
    def is_async(self) -> bool:
        """Whether it is an object store, whose operations need neither a connection per thread nor folders."""
        return bool(self._pair()[0].async_impl)

    def reopen(self) -> None:
        """Drop the connection of this thread, because it may be broken."""
        self._opened = threading.local()

    def ask(self, operation: str, *arguments: Any, seconds: float, **how: Any) -> Any:
        """Return what an operation, a method of fsspec, returns; TimeoutError without an answer in ``seconds``."""
        # The limit is needed because libraries retry by themselves, and give up a server that accepts connections but
        # does not answer only after minutes. After it, the operation may still be carried out. For file systems with a
        # connection per thread, their own limit applies instead.
        fs, _ = self._pair()
        coroutine = getattr(fs, f"_{operation}", None)
        if not (fs.async_impl and inspect.iscoroutinefunction(coroutine)):
            return getattr(fs, operation)(*arguments, **how)
        try:
            return sync(fs.loop, coroutine, *arguments, timeout=seconds, **how)
        except TimeoutError as error:
            raise TimeoutError(errno.ETIMEDOUT, f"no answer within {seconds:.0f} s") from error

    def forget_listings(self) -> None:
        """Make the next listing ask the server anew."""
        self._pair()[0].invalidate_cache()

    def _pair(self) -> tuple[Any, str]:
        """Return the file system and the path of the root in it."""
        opened: tuple[Any, str] | None = self._for_all_threads or getattr(self._opened, "pair", None)
        if opened is None:
            fs, root = fsspec.url_to_fs(self._url, use_listings_cache=False)
            if hasattr(fs, "max_concurrency"):
                fs.max_concurrency = 1  # s3fs asks for the size before it reads, to read large files in pieces at once
            opened = fs, str(root).rstrip("/")
            if fs.async_impl:
                self._for_all_threads = opened
            else:
                self._opened.pair = opened
        return opened
