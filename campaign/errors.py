"""Errors of a campaign that are not bugs, each with a complete message for the user, and statuses of failed runs."""

import errno
from collections.abc import Iterable
from enum import StrEnum
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # only callers that check something need to import the engine
    from engine.errors import Fault


class CampaignError(Exception):
    """The work failed.

    Attributes
    ----------
    exit_code : int
        Exit status of the command.
    """

    exit_code = 1


class SpecError(CampaignError):
    """The input is wrong: a campaign file, an option, the address of a store. Nothing was written.

    Parameters
    ----------
    message : str
        What is wrong; for a file, one line per fault.
    faults : iterable of Fault
        The faults of a file as data; empty if the wrong input is not a file.
    """

    exit_code = 2

    def __init__(self, message: str, faults: "Iterable[Fault]" = ()) -> None:
        super().__init__(message)
        self.faults = tuple(faults)


class StoreError(CampaignError):
    """The store or a disk cannot be reached, read or written; once it can be again, the same command works."""

    exit_code = 4


class FileGone(CampaignError, FileNotFoundError):
    """A file is not in the store; mostly because its campaign was deleted or changed while it was read."""


def file_gone(name: str) -> FileGone:
    """Return the error for a file that is not in the store."""
    return FileGone(f"{name}: is not in the store; if its campaign was deleted or changed just now, look again")


# Errors caused by the path that the user named; any other error comes from the disk or its server.
WRONG_PLACES = (PermissionError, FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError)
WRONG_NAMES = (errno.ENAMETOOLONG, errno.ELOOP, errno.EINVAL)


def unwritable(message: str, error: BaseException | None) -> CampaignError:
    """Return the error for a place that cannot be written: `StoreError` if a disk fails, else `SpecError`."""
    # It is the disk's fault if the disk is full, read-only, slow or out of reach; it is the user's fault if the place
    # does not exist, is of the wrong kind, belongs to another user, or has a name that no file can have.
    of_disk = isinstance(error, OSError) and not isinstance(error, WRONG_PLACES) and error.errno not in WRONG_NAMES
    return StoreError(message) if of_disk else SpecError(message)


class UnreachableError(CampaignError):
    """The scheduler or the cluster cannot be reached; the store keeps what it holds."""

    exit_code = 4


def error_named(kinds: Iterable[str], *modules: ModuleType) -> type[CampaignError] | None:
    """Return the first class of these names in some modules, made from a message alone; None if there is none."""
    found = (getattr(module, kind, None) for kind in kinds for module in modules)
    return next((each for each in found if isinstance(each, type) and issubclass(each, CampaignError)), None)


class FailedStatus(StrEnum):
    """The status of a row whose run is not ``ok``."""

    NOT_CONVERGED = "not_converged"
    NOT_AT_REST = "not_at_rest"
    JAMMED = "jammed"
    DIVERGED = "diverged"
    TIMEOUT = "timeout"
    INVALID = "invalid"
    NOT_ASSEMBLABLE = "not_assemblable"
    CRASHED = "crashed"
