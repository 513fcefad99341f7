"""Files of a store, in a folder or behind any fsspec URL: each is written whole or not at all."""

import os
import re
import shlex
import time
from collections.abc import Callable
from contextlib import nullcontext
from copy import copy
from itertools import chain, count
from typing import TYPE_CHECKING, TypeVar

from campaign.errors import SpecError, StoreError, file_gone, unwritable
from campaign.processes import STORE
from campaign.store.files.local import LocalFolder
from campaign.store.files.private_url import PrivateUrl
from campaign.store.files.retry_policy import HASTY, PATIENT, CircuitBreaker, Outage, RetryPolicy
from engine.platform.regular_file import UnfitFile

if TYPE_CHECKING:
    from campaign.store.files.object_store import ObjectStore

TEMPORARY = ".tmp"  # ending of files that are being written
LARGEST = 256 * 2**20  # bytes read into memory at once: ten times the largest file that a store should hold
DEAD_AFTER = 3600.0  # s: no write of one file takes this long
LONGEST_NAME = 500  # characters of a name relative to the root

T = TypeVar("T")


class Files:
    """Read and write files under one root.

    After a fault that may pass, an operation is tried again for as long as the policy allows; then `StoreError` is
    raised. A second attempt succeeds if the first one had done its work without confirming it.

    `breaker` is shared by concurrent callers that must not wait; `local` says whether the root is a folder of this
    machine, possibly shared with other machines.
    """

    def __init__(self, url: str, retry_policy: RetryPolicy = PATIENT, breaker: CircuitBreaker | None = None) -> None:
        self._private = PrivateUrl(url)
        self.retry_policy, self._breaker = retry_policy, breaker
        self.local = ("://" not in url and "::" not in url) or url.startswith(("file://", "local://"))
        folder = re.sub(r"^(file|local)://", "", url)
        self._backend = LocalFolder(folder) if self.local else _open_url(self._private, retry_policy)

    @property
    def url(self) -> str:
        """The folder or URL without its secrets, so that it may be shown."""
        return self._private.shown

    @property
    def full_url(self) -> str:
        """The path or URL with which any process opens the same files; it must never be shown, logged or stored."""
        return self._backend.root if isinstance(self._backend, LocalFolder) else self._private.full

    @property
    def has_secrets(self) -> bool:
        """Whether the full URL holds a password or another secret."""
        return self._private.has_secrets

    def command(self, verb: str, *words: str) -> str:
        """Return a complete ``clearcap`` command on this store, to copy: verb, arguments and further options."""
        return shlex.join(["clearcap", verb, *words, *self.option])

    @property
    def option(self) -> list[str]:
        """The words that name the store; none if the environment names one with a password, which stays unseen."""
        named = os.environ.get(STORE)
        if self.has_secrets and named is not None and PrivateUrl(named).shown == self.url:
            return []
        return ["--store", self.url]

    @property
    def hasty(self) -> "Files":
        """The same files for callers that must not wait: each operation is tried only once."""
        hasty = copy(self)
        hasty.retry_policy = HASTY
        hasty._backend = self._backend.within(HASTY.answer)
        return hasty

    @property
    def fault(self) -> str:
        """Why the store is known not to answer now; empty if it answers, or if there is no ``breaker``."""
        return self._breaker.fault if self._breaker else ""

    @property
    def shared(self) -> bool:
        """Whether other processes see the same files."""
        return self._backend.shared

    def path(self, name: str) -> str:
        """Return the full path of a name relative to the root; StoreError if it leads out of it or is not allowed."""
        check_name(self.url, name)
        return self._backend.path(name)

    def address(self, name: str) -> str:
        """Return the path or URL with which other programs open a file."""
        check_name(self.url, name)
        return self._backend.path(name) if self.local else f"{self.url.rstrip('/')}/{name}"

    def check_writable(self) -> None:
        """Check in one attempt that files can be written: SpecError if the user named a wrong place, or StoreError."""
        try:
            self._backend.probe()
        except Exception as error:  # every file system has its own errors
            message = f"store {self.url}: not writable ({self._reason(error)}); name a folder you may write to"
            raise unwritable(message, error) from self._cause(error)

    def read(self, name: str, at_most: int = LARGEST, *, must_exist: bool = False) -> bytes:
        """Return a file's content of at most ``at_most`` bytes; FileNotFoundError, OddFile or StoreError."""
        # ``must_exist`` says that the file is known to exist: if it is not found, the store may be unavailable, so the
        # read is tried again.
        return self._do(lambda path: self._backend.read(path, at_most), name, "read", must_exist=must_exist)

    def size(self, name: str) -> int:
        """Return a file's size in bytes, -1 if it is not a regular file; FileNotFoundError if it does not exist."""
        return self._do(self._backend.size, name, "read")

    def exists(self, name: str) -> bool:
        """Return whether there is such a file."""
        try:
            self.size(name)
        except FileNotFoundError:
            return False
        return True

    def sizes(self, folder: str) -> dict[str, int]:
        """Return the size of each file in a folder by name, as `size` does; empty if there is no such folder."""
        return self._do(self._backend.sizes, folder, "listed")

    def names(self, folder: str) -> list[str]:
        """Return the names of the files and folders in a folder, sorted; empty if there is no such folder."""
        return self._do(self._backend.names, folder, "listed")

    def stamps(self, folder: str) -> dict[str, str]:
        """Return a stamp for each name in a folder, behind a URL of all files below it; it differs after a change."""
        return self._do(self._backend.stamps, folder, "listed")

    def listed(self, folder: str) -> "Files":
        """Return these files for reading one folder; behind a URL it is listed only once, in this call."""
        if isinstance(self._backend, LocalFolder):
            return self
        from campaign.store.files.object_store import ListedObjects

        sizes, listed = self._do(self._backend.sizes_below, folder, "listed"), copy(self)
        listed._backend = ListedObjects(self._backend, self.path(folder), sizes)
        return listed

    def write(self, name: str, content: bytes) -> None:
        """Write a file whole or not at all, replacing an earlier one; StoreError if it contains the URL's secret."""
        self._refuse_secret(name, content)
        self._do(lambda path: self._backend.write(path, content), name, "written")

    def create(self, name: str, content: bytes) -> bool:
        """Write a file whole or not at all, unless it exists; return whether it was written."""
        # The content must name its writer, so that a writer can recognize that its own earlier attempt had succeeded.
        self._refuse_secret(name, content)
        return self._do(
            lambda path: self._backend.create(path, content) or self._backend.read(path, LARGEST) == content,
            name,
            "written",
        )

    def move(self, old: str, new: str) -> None:
        """Rename a file; behind a URL it is copied and then removed: both exist if the process is killed in between."""
        check_name(self.url, new)
        attempts = count(1)

        def move(path: str) -> None:
            repeated = next(attempts) > 1
            try:
                self._backend.move(path, self._backend.path(new))
            except FileNotFoundError:
                if not repeated:
                    raise
                self._backend.size(self._backend.path(new))  # FileNotFoundError, unless the first attempt moved it

        self._do(move, old, "moved")

    def remove(self, name: str) -> None:
        """Remove a file or an empty folder, if it exists."""
        self._do(self._backend.remove, name, "removed")

    def remove_tree(self, name: str) -> None:
        """Remove a file, or a folder with all its content, if it exists; links are not followed."""
        self._do(self._backend.remove_tree, name, "removed")

    def sweep(self, folder: str) -> None:
        """Remove the temporary files of dead writers from a folder."""
        self._do(lambda path: self._backend.sweep(path, TEMPORARY, DEAD_AFTER), folder, "swept")

    def _do(self, action: Callable[[str], T], name: str, what: str, *, must_exist: bool = False) -> T:
        """Return the result of an action on a file, trying again after faults that may pass while the policy allows."""
        check_name(self.url, name)
        with self._breaker.guarding() if self._breaker else nullcontext():
            return self._try(action, name, what, must_exist=must_exist)

    def _try(self, action: Callable[[str], T], name: str, what: str, *, must_exist: bool) -> T:
        outage = Outage(self.url, self.retry_policy)
        for pause in chain(self.retry_policy.pauses(), [None]):
            try:
                result = action(self._backend.path(name))
            except UnfitFile as error:
                raise OddFile(f"store {self.url}: {name}", str(error.strerror)) from error
            except self._backend.faults as error:
                missing = isinstance(error, FileNotFoundError | NotADirectoryError) and what in ("read", "moved")
                if missing and (pause is None or not must_exist):
                    outage.end()  # the store has answered
                    raise file_gone(name) from self._cause(error)
                fault = f"store {self.url}: {name or 'its folder'} cannot be {what} ({self._reason(error)})"
                if pause is None or (self._backend.is_final(error) and not missing):
                    raise StoreError(f"{fault}; {self._remedy}") from self._cause(error)
                outage.begin(fault)
                self._backend.reopen()
                time.sleep(pause)
            else:
                outage.end()
                return result
        raise AssertionError  # the last pause is None, at which the loop returns or raises

    def _refuse_secret(self, name: str, content: bytes) -> None:
        """Refuse to write a secret of the URL into the store, where every reader of results could see it."""
        if self.has_secrets and self._private.is_in(content):
            raise StoreError(
                f"store {self.url}: {name} is not written, because its content holds the password of the store's URL;"
                " leave the password out of the URL and give it in fsspec's configuration"
            )

    @property
    def _remedy(self) -> str:
        remedy = "free or repair the disk" if self.local else "check that it exists and can be reached"
        return f"{remedy}, then run the same command again"

    def _reason(self, error: Exception) -> str:
        text = (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__
        return self._private.redact(str(text))

    def _cause(self, error: Exception) -> Exception | None:
        """Return the cause to chain to an error; None if it might quote the URL with its secrets."""
        return None if self.has_secrets else error


def _open_url(url: PrivateUrl, retry_policy: RetryPolicy) -> "ObjectStore":
    from campaign.store.files.object_store import ObjectStore  # imports fsspec, which folders do not need

    try:
        return ObjectStore(url.full, retry_policy.answer)
    except (ValueError, ImportError) as error:
        raise SpecError(f"store {url}: {url.redact(str(error))}; name a folder, or a URL fsspec can open") from None


def check_name(store: str, name: str) -> None:
    """Raise StoreError for a name relative to the root that leads out of it, or that no file can have."""
    if (
        len(name) > LONGEST_NAME
        or not name.isprintable()
        or name.startswith(("/", "~"))
        or "\\" in name
        or ".." in name.split("/")
    ):
        shown = name if len(name) <= 60 else name[:57] + "..."
        raise StoreError(
            f"store {store}: {shown!r} is not a valid file name; names are relative, without .."
            f" and of at most {LONGEST_NAME} characters"
        )


class OddFile(StoreError):
    """A file that clearcap did not write: `where` names store and file, `reason` says what it is instead."""

    def __init__(self, where: str, reason: str) -> None:
        super().__init__(f"{where} {reason}, so clearcap did not write it; move it away")
        self.where, self.reason = where, reason

    def __reduce__(self) -> tuple[type["OddFile"], tuple[str, str]]:
        return OddFile, (self.where, self.reason)
