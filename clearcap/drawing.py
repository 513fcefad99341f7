"""Pictures of a mechanism, and of a run."""

from pathlib import Path

from clearcap.output_files import ANIMATIONS, PLOTS, check_output, replacing
from engine import Mechanism, Trajectory, read_trajectory


def draw(subject: Mechanism | Trajectory | str | Path, path: str | Path) -> None:
    """Draw a mechanism at its start, or a run.

    Parameters
    ----------
    subject : Mechanism, Trajectory, str or Path
        A mechanism, drawn with its springs and with what its responses measure; or a run: its motion, or the file that
        ``trajectory`` of `simulate` names.
    path : str or Path
        The picture: ``.png``, ``.svg`` or ``.pdf``, which of a run has the curves over time, or the loop that ``plot``
        of the mechanism asks for; a ``.gif``, ``.html`` or ``.mp4`` shows a run in motion. An older file is replaced.

    Raises
    ------
    SpecError
        If the file has another ending or its folder is missing, or an ``.mp4`` needs ffmpeg.
    TrajectoryError
        If the file of a run cannot be read.
    """
    target = Path(path)
    check_output("draw", target, PLOTS if isinstance(subject, Mechanism) else (*PLOTS, *ANIMATIONS))
    run = read_trajectory(subject) if isinstance(subject, str | Path) else subject
    with replacing(target) as temporary:
        if isinstance(run, Mechanism):
            from clearcap.pictures.sketch import plot_measurements

            plot_measurements(run, temporary)
        else:
            draw_run(run, temporary)


def draw_run(run: Trajectory, path: Path) -> None:
    """Write the figure of a run, or its animation, by the ending of the path."""
    from clearcap.pictures.animation import animate
    from clearcap.pictures.run_figure import plot_run

    (animate if path.suffix in ANIMATIONS else plot_run)(run, path)
