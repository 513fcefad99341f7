"""Files that the verbs `simulate` and `replay` write for one run: its trajectory, and pictures of it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from campaign.cli.output import say


@dataclass(frozen=True)
class RunFiles:
    """The files that a user requests for one run."""

    trajectory: Path | None  # HDF5 file with the motion
    plot: Path | None  # curves over time, or hysteresis on a test bench
    animation: Path | None

    def named(self) -> dict[str, str]:
        """Return the path of each file by its kind."""
        return {kind: str(path) for kind, path in vars(self).items() if path}

    def check(self) -> None:
        """Check, before the work begins, that the files can be written.

        Raises the errors of `check_output`, and SpecError if an animation needs ffmpeg, which is not installed.
        """
        from campaign.cli.output_files import ANIMATIONS, PLOTS, TRAJECTORIES, check_output
        from campaign.errors import SpecError

        for option, path, endings in (
            ("--trajectory", self.trajectory, TRAJECTORIES),
            ("--plot", self.plot, PLOTS),
            ("--animate", self.animation, ANIMATIONS),
        ):
            if path:
                check_output(option, path, endings)
        if self.animation:
            from campaign.pictures.animation import can_write

            if not can_write(self.animation.suffix):
                raise SpecError(
                    f"--animate {self.animation}: needs ffmpeg, which is not found; install it, or write .gif or .html"
                )

    @contextmanager
    def recording(self) -> Iterator[Path | None]:
        """Yield the path for the run's trajectory, or None; draw the pictures at the end of the block."""
        pictures = self.plot or self.animation
        with TemporaryDirectory(prefix="clearcap-") as folder:
            trajectory = self.trajectory or (Path(folder) / "motion.h5" if pictures else None)
            yield trajectory
            if trajectory and pictures:
                self._draw(trajectory)

    def _draw(self, trajectory: Path) -> None:
        """Draw the pictures of a trajectory."""
        from campaign.cli.output_files import replacing
        from campaign.pictures.animation import animate
        from campaign.pictures.run_figure import plot_run
        from engine import read_trajectory

        recorded = read_trajectory(trajectory)
        for path, draw in ((self.plot, plot_run), (self.animation, animate)):
            if path:
                say(f"drawing {path}")
                with replacing(path) as temporary:
                    draw(recorded, temporary)
