"""The file system that fsspec opens for a URL, and how long its server may take to answer."""

import errno
import inspect
import threading
from typing import Any

import fsspec
from fsspec.asyn import sync
from fsspec.core import split_protocol

SLOWEST = 500e3  # bytes/s; the slowest connection to a server that is allowed for
MANY_FILES = 60.0  # s, added for an operation that the server answers in many pieces


class OpenedFileSystem:
    """The file system of an fsspec URL, given with its secrets; opened at first use.

    A file system with a connection of its own (FTP, SFTP) is opened once in each thread, because two threads cannot
    share one connection. `shared` says whether other processes see the same files. Raises ValueError or ImportError if
    the file system is not installed.
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
        """Return what an operation, a method of fsspec, returns; TimeoutError without an answer in ``seconds``.

        The limit is needed because libraries retry by themselves, and give up a server that accepts connections but
        does not answer only after minutes. After it, the operation may still be carried out. For file systems with a
        connection per thread, their own limit applies instead.
        """
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
