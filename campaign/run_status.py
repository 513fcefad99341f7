"""The statuses of failed runs, in a module light enough for the options of the command to import."""

from enum import StrEnum


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
