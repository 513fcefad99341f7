"""Jobs for one sample of a campaign: repeat it, draw its curves and its motion."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from campaign.store import open_store
from campaign.store.files.retry_policy import QUICK
from clearcap.questions.replayed import replay_sample
from engine import Trajectory, read_trajectory

ANIMATION_FRAMES = 45  # half the frames of the command line, so that the animation is ready within seconds


def replay_document(store: str, campaign: str, sample: int) -> dict[str, Any]:
    """Return the document of ``clearcap replay --json``; see `clearcap.questions.replayed.replay_sample`."""
    opened = open_store(store, QUICK)
    return replay_sample(opened, opened.plan(campaign), sample).document()


def draw_sample(store: str, campaign: str, sample: int, kind: str) -> bytes:
    """Repeat a sample and return a picture of it: ``svg``, its curves over time, or ``gif``, its motion."""
    from clearcap.pictures.animation import animate
    from clearcap.pictures.run_figure import plot_run

    with _repeated(store, campaign, sample) as recorded, TemporaryDirectory(prefix="clearcap-") as folder:
        picture = Path(folder, f"picture.{kind}")
        if kind == "gif":
            animate(recorded, picture, ANIMATION_FRAMES)
        else:
            plot_run(recorded, picture)
        return picture.read_bytes()


def sample_motion(store: str, campaign: str, sample: int) -> dict[str, Any]:
    """Repeat a sample and return its motion, a `MovingDrawing`; see `draw_sample` for the parameters."""
    from clearcap.pictures.moving_drawing import moving_drawing
    from clearcap.pictures.scene import scene_of

    with _repeated(store, campaign, sample) as recorded:
        return asdict(moving_drawing(scene_of(recorded, ANIMATION_FRAMES), recorded))


@contextmanager
def _repeated(store: str, campaign: str, sample: int) -> Iterator[Trajectory]:
    """Repeat a sample and yield its trajectory, whose file exists only in the block."""
    opened = open_store(store, QUICK)
    with TemporaryDirectory(prefix="clearcap-") as folder:
        motion = Path(folder, "motion.h5")
        replay_sample(opened, opened.plan(campaign), sample, motion)
        yield read_trajectory(motion)
