"""Animation of a run: bodies and contact forces on one plane, and beside them the magnified play of each joint."""

import re
from pathlib import Path
from typing import Any

from campaign.pictures.animation_figure import DPI, SIZE, AnimationFigure
from campaign.pictures.curves import heading
from campaign.pictures.scene import scene_of
from campaign.pictures.style import styled
from engine import Trajectory

FRAMES, PER_SECOND = 90, 15
HOLD = 20  # frames for which the last one stays before the animation begins again
LARGEST_PAGE = 100.0  # MB; matplotlib leaves out the frames beyond
SYMBOLS = {
    "minus": "slower",
    "fast-backward": "&#9198;",
    "step-backward": "&lt;",
    "play fa-flip-horizontal": "&#9664;",
    "pause": "&#9208;",
    "play": "&#9654;",
    "step-forward": "&gt;",
    "fast-forward": "&#9197;",
    "plus": "faster",
}


def animate(trajectory: Trajectory, path: Path, frames: int | None = None) -> None:
    """Write an animation of a run: ``.gif``, ``.html``, or with ffmpeg ``.mp4``.

    It has at most `frames` frames, by default 90; they are dense where much moves, see `poses.progress`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    scene = scene_of(trajectory, frames or FRAMES)
    with styled(**{"axes.titley": 1.02}):  # fixed, because otherwise every frame measures the titles
        figure = Figure(figsize=SIZE, dpi=DPI)
        FigureCanvasAgg(figure)
        drawing = AnimationFigure(figure, scene, trajectory)
        with (writer := _writer(path.suffix)).saving(figure, str(path), DPI):
            for frame in range(len(scene.time)):
                drawing.show(frame)
                writer.grab_frame()
            if path.suffix != ".html":  # a page has a button to stop it
                _hold(writer, HOLD)
    if path.suffix == ".html":
        path.write_text(_page(path.read_text("utf-8"), f"{len(scene.time)} frames of {heading(trajectory)}"), "utf-8")


def _hold(writer: Any, frames: int) -> None:
    """Keep showing the last frame for a number of frames."""
    from campaign.pictures.gif import GifWriter

    if isinstance(writer, GifWriter):
        writer.hold(frames)
        return
    for _ in range(frames):
        writer.grab_frame()


def can_write(suffix: str) -> bool:
    """Return whether this machine can write animations with this ending."""
    with styled():
        return bool(_writer(suffix).isAvailable())


def _writer(suffix: str) -> Any:
    from matplotlib.animation import FFMpegWriter, HTMLWriter

    from campaign.pictures.gif import GifWriter

    if suffix == ".html":
        return HTMLWriter(fps=PER_SECOND, embed_frames=True, default_mode="loop", embed_limit=LARGEST_PAGE)
    return FFMpegWriter(fps=PER_SECOND) if suffix == ".mp4" else GifWriter(fps=PER_SECOND)


def _page(player: str, label: str) -> str:
    """Return matplotlib's player as a page that needs no network and has a description for screen readers."""
    from html import escape

    player = re.sub(r'<link rel="stylesheet"[^>]*>', "", player)
    player = re.sub(r'<i class="fa fa-([a-z -]+)"></i>', lambda match: SYMBOLS[match[1]], player)
    player = player.replace("<img ", f'<img alt="{escape(label)}" ', 1)
    # matplotlib's player is an inline script; the page neither loads nor sends anything
    policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
    head = f'<meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{policy}">'
    head += f"<title>{escape(label)}</title>"
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n{player}\n</body></html>\n'
