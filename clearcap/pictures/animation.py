"""Animation of a run: bodies and contact forces on one plane, and beside them the magnified play of each joint."""

import re
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, HTMLWriter
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from PIL import Image

from clearcap.pictures.play import Play
from clearcap.pictures.run_figure import heading
from clearcap.pictures.scene import CUT, HOLD, PER_SECOND, TRAIL, BodyFrames, Scene, scene_of, zigzag
from clearcap.pictures.style import FORCE, GRID, INK, MARKERS, MUTED, PALETTE, hide_axes, styled
from engine import Trajectory
from engine.arrays import Array

SIZE, DPI = (10.0, 6.2), 90
FRAMES = 90
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
    """Write an animation of a run: ``.gif``, ``.html``, or with ffmpeg ``.mp4``; see `view.progress` for its frames."""
    scene = scene_of(trajectory, frames or FRAMES)
    with styled(**{"axes.titley": 1.02}):  # fixed, because otherwise every frame measures the titles
        figure = Figure(figsize=SIZE, dpi=DPI)
        FigureCanvasAgg(figure)
        drawing = AnimationFigure(figure, scene)
        with (writer := _writer(path.suffix)).saving(figure, str(path), DPI):
            for frame in range(len(scene.time)):
                drawing.show(frame)
                writer.grab_frame()
            if isinstance(writer, GifWriter):
                writer.hold(HOLD)
            elif path.suffix != ".html":  # a page has a button to stop it
                for _ in range(HOLD):
                    writer.grab_frame()
    if path.suffix == ".html":
        path.write_text(_page(path.read_text("utf-8"), f"{len(scene.time)} frames of {heading(trajectory)}"), "utf-8")


def can_write(suffix: str) -> bool:
    """Return whether this machine can write animations with this ending."""
    with styled():
        return bool(_writer(suffix).isAvailable())


def _writer(suffix: str) -> Any:
    if suffix == ".html":
        return HTMLWriter(fps=PER_SECOND, embed_frames=True, default_mode="loop", embed_limit=LARGEST_PAGE)
    return FFMpegWriter(fps=PER_SECOND) if suffix == ".mp4" else GifWriter(fps=PER_SECOND)


def _page(player: str, label: str) -> str:
    """Return matplotlib's player as a page that needs no network and has a description for screen readers."""
    player = re.sub(r'<link rel="stylesheet"[^>]*>', "", player)
    player = re.sub(r'<i class="fa fa-([a-z -]+)"></i>', lambda match: SYMBOLS[match[1]], player)
    player = player.replace("<img ", f'<img alt="{escape(label)}" ', 1)
    # matplotlib's player is an inline script; the page neither loads nor sends anything
    policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
    head = f'<meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{policy}">'
    head += f"<title>{escape(label)}</title>"
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n{player}\n</body></html>\n'


class AnimationFigure:
    """The figure of an animation; `show` moves it to a frame."""

    def __init__(self, figure: Figure, scene: Scene) -> None:
        self._scene = scene
        self._title = figure.suptitle("", x=0.02, ha="left", fontsize=10)
        wide = 0.62 if scene.plays else 0.96
        axes = figure.add_axes((0.02, 0.1, wide, 0.82))
        hide_axes(axes)
        (left, bottom), (right, top) = scene.corners
        axes.set(xlim=(left, right), ylim=(bottom, top))
        self._bodies = [_Body(axes, name, body, scene.colours[name]) for name, body in scene.bodies.items()]
        self._springs = [axes.plot([], [], color=INK, linewidth=0.9)[0] for _ in scene.springs]
        self._arrows = np.where(scene.arrows.any(axis=-1, keepdims=True), scene.arrows, np.nan)  # NaN: not even a dot
        self._quiver = _quiver(axes, scene.points[0], self._arrows[0])
        if scene.common:  # the key
            _quiver(axes, scene.corners[:1], np.array([[scene.long, 0.0]]))
            force = f"{scene.common:g} {scene.units['force']} (mean since the last frame)"
            text = f" {force}; longer arrows than {CUT:g} of these are clipped"
            axes.text(left + scene.long, bottom, text, va="center", fontsize=8)
        insets = _grid(figure, len(scene.plays))
        self._insets = [_Inset(a, p, scene.units["length"]) for a, p in zip(insets, scene.plays, strict=True)]
        if scene.plays:
            _explain_insets(figure, max(play.eccentricity.shape[1] for play in scene.plays))
        self._clock = _clock(figure, wide, float(scene.time[-1]), scene.units["time"])

    def show(self, frame: int) -> None:
        """Draw a frame."""
        scene = self._scene
        self._title.set_text(f"{scene.name}   t = {scene.time[frame]:.4g} {scene.units['time']}")
        for body in self._bodies:
            body.show(frame)
        for line, ends in zip(self._springs, scene.springs, strict=True):
            line.set_data(*zigzag(*ends[frame]).T)
        self._quiver.set_offsets(scene.points[frame])
        self._quiver.set_UVC(*self._arrows[frame].T)
        self._clock.set_data([0.0, scene.time[frame]], [0.0, 0.0])
        for inset in self._insets:
            inset.show(scene.rows[max(frame - TRAIL, 0)], scene.rows[frame])


class _Body:
    def __init__(self, axes: Axes, name: str, body: BodyFrames, colour: str) -> None:
        self._body = body
        self._outline: Any = None
        if not body.fixed and body.outline.shape[1]:
            wide = {1: 0.0, 2: 5.0}.get(body.outline.shape[1], 1.2)  # a body whose outline is a line is drawn as a rod
            (self._outline,) = axes.fill([0], [0], facecolor=colour + "30", edgecolor=colour, linewidth=wide)
            self._outline.set_joinstyle("round")
        (self._lines,) = axes.plot([], [], color=colour, linewidth=1.0)
        (self._faces,) = axes.plot([], [], color=colour, linewidth=2.2, solid_capstyle="butt")
        (self._joints,) = axes.plot([], [], "o", color=INK, markerfacecolor="white", markersize=4)
        words: Any = {"color": colour, "fontsize": 8, "fontweight": "bold", "clip_on": True}
        self._name = axes.text(0, 0, "" if body.fixed else name, **words)

    def show(self, frame: int) -> None:
        """Move the body to a frame."""
        if self._outline is not None:
            corners = self._body.outline[frame]
            self._outline.set_xy(corners)
            self._name.set_position(tuple(0.5 * (corners.min(axis=0) + corners.max(axis=0))))
        self._lines.set_data(*join_lines([line[frame] for line in self._body.lines]).T)
        self._faces.set_data(*join_lines([face[frame] for face in self._body.faces]).T)
        self._joints.set_data(*self._body.joints[frame].T)


def _clock(figure: Figure, wide: float, end: float, unit: str) -> Any:
    """Draw a line from the start to the end of the run, and return the line on top of it that shows the time."""
    axes = figure.add_axes((0.1, 0.03, wide - 0.16, 0.02))
    axes.set_axis_off()
    axes.set(xlim=(0.0, end or 1.0), ylim=(-1.0, 1.0))
    axes.plot([0.0, end], [0.0, 0.0], color=GRID, linewidth=4, clip_on=False, solid_capstyle="butt")
    for x, side, text in ((-0.01, "right", f"0 {unit}"), (1.01, "left", f"{end:.4g} {unit}")):
        axes.text(x, 0.5, text, transform=axes.transAxes, ha=side, va="center", fontsize=8, color=MUTED)
    return axes.plot([], [], color=MUTED, linewidth=4, clip_on=False, solid_capstyle="butt")[0]


def _quiver(axes: Axes, points: Array, arrows: Array) -> Any:
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.004, "headwidth": 4, "clip_on": False}
    return axes.quiver(*points.T, *arrows.T, color=FORCE, zorder=5, **style)


class _Inset:
    """The circle that limits a journal's axis, the axis's position, and its path."""

    def __init__(self, axes: Axes, play: Play, unit: str) -> None:
        self._eccentricity = play.eccentricity
        hide_axes(axes)
        axes.set(xlim=(-1.25, 1.25), ylim=(-1.25, 1.25))
        axes.set_title(f"{play.joint}: play {play.clearance:.3g} {unit}", loc="center", fontsize=8)
        axes.add_patch(Circle((0, 0), 1.0, facecolor="#f4f6f9", edgecolor=INK, linewidth=1.2))
        axes.plot([-0.08, 0.08, np.nan, 0, 0], [0, 0, np.nan, -0.08, 0.08], color=MUTED, linewidth=0.8)
        rings = range(play.eccentricity.shape[1])
        colours = [PALETTE[i % len(PALETTE)] for i in rings]
        self._trails = [axes.plot([], [], color=c, linewidth=0.8, alpha=0.6)[0] for c in colours]
        self._dots = [
            axes.plot([], [], MARKERS[i % len(MARKERS)], color=colours[i], markersize=max(9 - 3 * i, 4))[0]
            for i in rings
        ]

    def show(self, since: int, row: int) -> None:
        """Draw the position of the axis at a row, and its path since an earlier row."""
        for ring, (trail, dot) in enumerate(zip(self._trails, self._dots, strict=True)):
            trail.set_data(*self._eccentricity[since : row + 1, ring].T)
            dot.set_data(*self._eccentricity[row : row + 1, ring].T)


def join_lines(lines: list[Array]) -> Array:
    """Return polylines, each of shape (k, 2), as one polyline with gaps."""
    gap = np.full((1, 2), np.nan)
    return np.vstack([gap, *(part for line in lines for part in (line, gap))])


def _explain_insets(figure: Figure, rings: int) -> None:
    figure.text(0.65, 0.045, "axis of each journal in its bearing; circle: its clearance", fontsize=8)
    for i in range(rings if rings > 1 else 0):
        x = 0.66 + 0.09 * i
        mark, colour = MARKERS[i % len(MARKERS)], PALETTE[i % len(PALETTE)]
        figure.add_artist(Line2D([x], [0.02], marker=mark, color=colour, markersize=6, linestyle=""))
        figure.text(x + 0.012, 0.02, f"ring {i + 1}", fontsize=8, va="center")


def _grid(figure: Figure, count: int) -> list[Axes]:
    columns = 1 if count <= 3 else 2 if count <= 8 else 3
    rows = max(-(-count // columns), 2)
    wide, high = 0.34 / columns, 0.84 / rows
    return [
        figure.add_axes((0.65 + wide * (i % columns), 0.93 - high * (i // columns + 1), 0.95 * wide, 0.82 * high))
        for i in range(count)
    ]


AREAS, OTHERS = 16, 32  # number of colours for large areas, and for all else
CLOSE = 8  # of 256 in each channel; closer colours count as one


class GifWriter(AbstractMovieWriter):
    """A writer of GIFs for matplotlib, with one palette for all frames, so that only what changes takes space."""

    @classmethod
    def isAvailable(cls) -> bool:  # matplotlib's name
        """Return True: only Pillow is needed, which matplotlib depends on."""
        return True

    def setup(self, fig: Any, outfile: Any, dpi: Any = None) -> None:
        """Start without frames."""
        super().setup(fig, outfile, dpi)  # type: ignore[no-untyped-call]
        self._frames: list[Image.Image] = []
        self._held = 0

    def grab_frame(self, **_: Any) -> None:
        """Add the current figure as a frame."""
        canvas: Any = self.fig.canvas
        canvas.draw()
        self._frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3]))

    def hold(self, frames: int) -> None:
        """Show the last frame for the time of ``frames`` further ones, without drawing it again."""
        self._held = frames

    def finish(self) -> None:
        """Write the frames in the colours of the middle one; the last frame is shown for the time of held frames."""
        palette = palette_of(self._frames[min((len(self._frames) + self._held) // 2, len(self._frames) - 1)])
        frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in self._frames]
        each = round(1000 / self.fps)
        durations = [each] * (len(frames) - 1) + [each * (1 + self._held)]
        frames[0].save(self.outfile, save_all=True, append_images=frames[1:], duration=durations, loop=0)


def palette_of(frame: Image.Image) -> Image.Image:
    """Return an image with a palette of the exact colours of large areas, and others that differ clearly from these."""
    red, green, blue = np.moveaxis(np.asarray(frame, np.uint32), -1, 0)
    packed, count = np.unique(red << 16 | green << 8 | blue, return_counts=True)  # sorting numbers is faster
    colours = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1)
    covering = frame.quantize(OTHERS, method=Image.Quantize.MAXCOVERAGE)  # keeps the hue of a thin arrow
    others = np.reshape(covering.getpalette() or [], (-1, 3))
    chosen = np.empty((0, 3), int)
    for colour in [*colours[np.argsort(-count)[:AREAS]].astype(int), *others]:
        if (np.abs(chosen - colour).max(axis=1) > CLOSE).all():  # Pillow would confuse closer colours
            chosen = np.vstack([chosen, colour])
    palette = Image.new("P", (1, 1))
    palette.putpalette(chosen.ravel().tolist())
    return palette
