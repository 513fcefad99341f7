"""Errors of the engine: every message is complete and meant for the person who reads it."""

from collections.abc import Iterable

from engine.faults.fault import Fault


class EngineError(Exception):
    """Base of every error the engine raises on purpose."""


class MechanismError(EngineError):
    """The description of a mechanism, or a value that is set in it, is wrong.

    Parameters
    ----------
    message : str
        The file or mechanism, then one line for each fault.
    faults : iterable of Fault
        The same as data; none where no single key is at fault.
    """

    def __init__(self, message: str, faults: Iterable[Fault] = ()) -> None:
        super().__init__(message)
        self.faults = tuple(faults)


class CadError(EngineError):
    """A CAD file cannot be read, or does not hold what is asked of it."""


class TrajectoryError(EngineError):
    """A trajectory file cannot be written or read."""


class FolderError(EngineError):
    """Somebody else could have filled the folder of compiled code: what is in it is not run."""
