"""Errors of the engine: each message is complete and addressed to the user."""

from collections.abc import Iterable

from engine.faults.fault import Fault


class EngineError(Exception):
    """Base class of all errors that the engine raises deliberately."""


class MechanismError(EngineError):
    """The description of a mechanism, or a value set in it, is wrong.

    Parameters
    ----------
    message : str
        The file or mechanism, followed by one line per fault.
    faults : iterable of Fault
        The same faults as data; empty if the error cannot be attributed to a single key.
    """

    def __init__(self, message: str, faults: Iterable[Fault] = ()) -> None:
        super().__init__(message)
        self.faults = tuple(faults)


class NotAssemblable(MechanismError):
    """The parts overlap as drawn, or ideal joints are open, and no start pose nearby puts that right.

    Parameters
    ----------
    message : str
        The mechanism, one line per overlap and open joint, and the reason.
    reason : str
        What is in the way, in one sentence with its numbers.
    """

    def __init__(self, message: str, reason: str) -> None:
        super().__init__(message)
        self.reason = reason

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        """Return how to make it again in another process."""
        return type(self), (str(self), self.reason)


class CadError(EngineError):
    """A CAD file cannot be read, or does not contain what is requested of it."""


class TrajectoryError(EngineError):
    """A trajectory file cannot be written or read."""


class FolderError(EngineError):
    """The folder of compiled code is not safe: another user could have put files there, so none of it is run."""


class UnsupportedNumbaError(EngineError, ImportError):
    """The installed Numba lacks what the engine cannot do without."""
