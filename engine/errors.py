"""Errors of the engine: every message is complete and meant for the person who reads it."""


class EngineError(Exception):
    """Base of every error the engine raises on purpose."""


class MechanismError(EngineError):
    """The description of a mechanism, or a value that is set in it, is wrong.

    Parameters
    ----------
    message : str
        The file or mechanism, then one line for each fault.
    """


class TrajectoryError(EngineError):
    """A trajectory file cannot be written or read."""


class FolderError(EngineError):
    """Somebody else could have filled the folder of compiled code: what is in it is not run."""
