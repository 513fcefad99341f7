"""Errors of a campaign that are no bugs; every message is complete and written for the user."""

import errno
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the engine is imported by those alone who check something
    from engine.faults.fault import Fault


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
        What is wrong; of a file, one line for each fault.
    faults : iterable of Fault
        The faults of a file as data; none where it is no file that is wrong.
    """

    exit_code = 2

    def __init__(self, message: str, faults: "Iterable[Fault]" = ()) -> None:
        super().__init__(message)
        self.faults = tuple(faults)


class StoreError(CampaignError):
    """The store, or a disk, cannot be reached, read or written; the same command works when it can."""

    exit_code = 4


# What is wrong with a place that a user names; any other error is one of the disk or of its server.
WRONG_PLACES = (PermissionError, FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError)
WRONG_NAMES = (errno.ENAMETOOLONG, errno.ELOOP, errno.EINVAL)


def unwritable(message: str, error: BaseException | None) -> CampaignError:
    """Return the error of a place that cannot be written: `StoreError` if a disk fails, else `SpecError`.

    Parameters
    ----------
    message : str
        The message for the user.
    error : BaseException or None
        What the system said. A disk fails when it is full, read-only, slow or out of reach. The user errs with a place
        that does not exist, is of another kind, or is another's, and with a name that no file can have.
    """
    of_disk = isinstance(error, OSError) and not isinstance(error, WRONG_PLACES) and error.errno not in WRONG_NAMES
    return StoreError(message) if of_disk else SpecError(message)


class UnreachableError(CampaignError):
    """The scheduler or the cluster cannot be reached; the store keeps what it holds."""

    exit_code = 4
