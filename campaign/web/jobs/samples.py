"""Jobs about one sample of a campaign: repeat it, draw its curves and its motion."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from campaign.reports.replayed import replay_sample
from campaign.store import open_store
from campaign.store.files.patience import QUICK
from engine import read_trajectory

ANIMATION_FRAMES = 45  # half of what the command draws, so that it comes within seconds


def replay_document(store: str, campaign: str, sample: int) -> dict[str, Any]:
    """Return the document of ``clearcap replay --json``; see `campaign.reports.replayed.replay_sample`."""
    opened = open_store(store, QUICK)
    return replay_sample(opened, opened.plan(campaign), sample).document()


def draw_sample(store: str, campaign: str, sample: int, kind: str) -> bytes:
    """Repeat a sample and return a picture of it.

    Parameters
    ----------
    store, campaign : str
        Path or URL of the store, with what access takes; id of the campaign.
    sample : int
        Number of the sample.
    kind : str
        ``svg``, its curves over time, or ``gif``, its motion.
    """
    from campaign.pictures.animation import animate
    from campaign.pictures.run_figure import plot_run

    opened = open_store(store, QUICK)
    with TemporaryDirectory(prefix="clearcap-") as folder:
        motion, picture = Path(folder, "motion.h5"), Path(folder, f"picture.{kind}")
        replay_sample(opened, opened.plan(campaign), sample, motion)
        recorded = read_trajectory(motion)
        if kind == "gif":
            animate(recorded, picture, ANIMATION_FRAMES)
        else:
            plot_run(recorded, picture)
        return picture.read_bytes()
