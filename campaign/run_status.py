"""How a run that failed may have ended; light, so that options can name it."""

from enum import StrEnum


class FailedStatus(StrEnum):
    """The status of a row whose run is not ``ok``."""

    NOT_CONVERGED = "not_converged"
    NOT_AT_REST = "not_at_rest"
    JAMMED = "jammed"
    DIVERGED = "diverged"
    TIMEOUT = "timeout"
    INVALID = "invalid"
    CRASHED = "crashed"
