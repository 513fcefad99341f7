"""Errors of the engine: every message is complete and meant for the person who reads it."""


class EngineError(Exception):
    """Base of every error the engine raises on purpose."""


class MechanismError(EngineError):
    """The description of a mechanism, or a value to be put into it, is wrong.

    Parameters
    ----------
    message : str
        All that the user needs: the file or mechanism, then one line for each fault.
    """


class TrajectoryError(EngineError):
    """A trajectory file cannot be written, or what should be one cannot be read."""
