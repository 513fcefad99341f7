"""What is kept of the motion of a run."""

from numbers import Integral
from pathlib import Path
from typing import NamedTuple

from engine.errors import TrajectoryError


class Recording(NamedTuple):
    """A trajectory file of which not every step is written.

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
        """Return the recording that is meant: a path alone means every step.

        Raises
        ------
        TrajectoryError
            If ``every`` is not allowed.
        """
        recording = trajectory if isinstance(trajectory, cls) else cls(trajectory)  # type: ignore[arg-type]
        if not isinstance(recording.every, Integral) or isinstance(recording.every, bool) or recording.every < 1:
            raise TrajectoryError(f"every = {recording.every!r}: allowed: a whole number >= 1; 1 writes each step")
        return recording
