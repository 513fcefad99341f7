"""Files that a user names on the command line, checked before the work begins and written whole or not at all."""

import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from campaign.errors import SpecError, unwritable
from clearcap.cli.output import say

TRAJECTORIES, PLOTS, ANIMATIONS = (".h5", ".hdf5"), (".png", ".svg", ".pdf"), (".gif", ".html", ".mp4")


def check_output(option: str, path: Path, endings: tuple[str, ...]) -> None:
    """Check that a file can be written; no file remains.

    Raises SpecError if the ending is not allowed, the folder does not exist or the user may not write to it; StoreError
    if the disk is full, read-only or out of reach.
    """
    if path.suffix not in endings:
        raise SpecError(f"{option} {path}: unknown ending; allowed: {', '.join(endings)}; name a file with one of them")
    if path.is_dir():
        raise SpecError(f"{option} {path}: is a folder; name a file")
    if not path.parent.is_dir():
        raise SpecError(f"{option} {path}: no folder {path.parent}; make it, or name a file in another one")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        message = f"{option} {path}: not writable ({error.strerror}); name a file in a folder you may write to"
        raise unwritable(message, error) from error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside a file, with the same ending; at the end of the block it replaces the file.

    Raises StoreError or SpecError if it cannot be written; an earlier file stays unchanged.
    """
    temporary = path.with_name(f"{path.stem}.{os.getpid()}-{secrets.token_hex(4)}.tmp{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or error
        message = f"{path}: cannot be written ({reason}); free or repair the disk, then run again"
        raise unwritable(message, error) from error
    finally:
        temporary.unlink(missing_ok=True)


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
        for option, path, endings in (
            ("--trajectory", self.trajectory, TRAJECTORIES),
            ("--plot", self.plot, PLOTS),
            ("--animate", self.animation, ANIMATIONS),
        ):
            if path:
                check_output(option, path, endings)
        if self.animation:
            from clearcap.pictures.animation import can_write

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
        from clearcap.pictures.animation import animate
        from clearcap.pictures.run_figure import plot_run
        from engine import read_trajectory

        recorded = read_trajectory(trajectory)
        for path, draw in ((self.plot, plot_run), (self.animation, animate)):
            if path:
                say(f"drawing {path}")
                with replacing(path) as temporary:
                    draw(recorded, temporary)
