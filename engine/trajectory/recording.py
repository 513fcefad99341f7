"""The settings of a recording: the trajectory file and the steps it contains."""

from numbers import Integral
from pathlib import Path
from typing import NamedTuple

from engine.errors import TrajectoryError


class Recording(NamedTuple):
    """A trajectory file that need not contain every step.

    Attributes
    ----------
    path : str or Path
        The file; an existing one is replaced.
    every : int
        Write every ``every``-th step, and always the first and the last state.
    """

    path: str | Path
    every: int = 1

    @classmethod
    def of(cls, trajectory: "str | Path | Recording") -> "Recording":
        """Return a recording unchanged; a path alone means a recording of every step.

        Raises
        ------
        TrajectoryError
            If ``every`` is not allowed.
        """
        recording = trajectory if isinstance(trajectory, cls) else cls(trajectory)  # type: ignore[arg-type]
        if not isinstance(recording.every, Integral) or isinstance(recording.every, bool) or recording.every < 1:
            raise TrajectoryError(f"every = {recording.every!r}: allowed: a whole number >= 1; 1 writes each step")
        return recording
