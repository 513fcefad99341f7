"""Animation of a run: bodies and contact forces on one plane, and beside them the magnified play of each joint."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from clearcap.pictures.play import Play
from clearcap.pictures.run_figure import heading
from clearcap.pictures.scene import BodyFrames, Scene, scene_of
from clearcap.pictures.style import FORCE, GRID, INK, MARKERS, MUTED, PALETTE, hide_axes, styled
from engine import Trajectory
from engine.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COMMON = 95  # percentile of the nonzero forces that gives the common force
ARROW = 0.1  # length of the arrow of the common force, in diagonals of the box
CUT = 2.0  # longer arrows are cut at this multiple of that length
SIZE, DPI = (10.0, 6.2), 90
TRAIL = 12  # frames for which the path of a journal stays visible
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
    from clearcap.pictures.gif import GifWriter

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

    from clearcap.pictures.gif import GifWriter

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


class AnimationFigure:
    """The figure of an animation; `show` moves it to a frame. The trajectory supplies its name and units."""

    def __init__(self, figure: "Figure", scene: Scene, trajectory: Trajectory) -> None:
        self._scene, self._unit = scene, trajectory.units["time"]
        self._name = trajectory.description.get("title") or trajectory.description["name"]
        mechanism = trajectory.mechanism()
        self._title = figure.suptitle("", x=0.02, ha="left", fontsize=10)
        wide = 0.62 if scene.plays else 0.96
        axes = figure.add_axes((0.02, 0.1, wide, 0.82))
        hide_axes(axes)
        common, long = common_force(scene.forces), ARROW * float(np.linalg.norm(np.diff(scene.box, axis=0)))
        arrows = arrow_lengths(scene.forces, common, long)
        low, high = limits(scene.box, scene.points + arrows)
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        moving = [name for name, body in scene.bodies.items() if not body.fixed]
        colours = {name: PALETTE[i % len(PALETTE)] for i, name in enumerate(moving)}
        self._bodies = [_Body(axes, name, body, colours.get(name, MUTED)) for name, body in scene.bodies.items()]
        self._springs = [axes.plot([], [], color=INK, linewidth=0.9)[0] for _ in scene.springs]
        self._arrows = _Arrows(axes, scene.points, arrows)
        if common:
            _explain_arrows(axes, low, long, f"{common:g} {mechanism.unit('force')}")
        insets = _grid(figure, len(scene.plays))
        self._insets = [_Inset(a, p, mechanism.unit("length")) for a, p in zip(insets, scene.plays, strict=True)]
        if scene.plays:
            _explain_insets(figure, max(play.eccentricity.shape[1] for play in scene.plays))
        self._clock = _clock(figure, wide, float(scene.time[-1]), self._unit)

    def show(self, frame: int) -> None:
        """Draw a frame."""
        scene = self._scene
        self._title.set_text(f"{self._name}   t = {scene.time[frame]:.4g} {self._unit}")
        for body in self._bodies:
            body.show(frame)
        for line, ends in zip(self._springs, scene.springs, strict=True):
            line.set_data(*zigzag(*ends[frame]).T)
        self._arrows.show(frame)
        self._clock.set_data([0.0, scene.time[frame]], [0.0, 0.0])
        for inset in self._insets:
            inset.show(scene.rows[max(frame - TRAIL, 0)], scene.rows[frame])


class _Body:
    """The artists of one body."""

    def __init__(self, axes: "Axes", name: str, body: BodyFrames, colour: str) -> None:
        self._body = body
        self._outline: Any = None
        if not body.fixed and body.outline.shape[1]:
            wide = {1: 0.0, 2: 5.0}.get(body.outline.shape[1], 1.2)  # a body whose outline is a line is drawn as a rod
            (self._outline,) = axes.fill([0], [0], facecolor=colour + "30", edgecolor=colour, linewidth=wide)
            self._outline.set_joinstyle("round")
        (self._lines,) = axes.plot([], [], color=colour, linewidth=1.0)
        (self._faces,) = axes.plot([], [], color=colour, linewidth=2.2, solid_capstyle="butt")
        (self._joints,) = axes.plot([], [], "o", color=INK, markerfacecolor="white", markersize=4)
        self._name = axes.text(
            0, 0, "" if body.fixed else name, color=colour, fontsize=8, fontweight="bold", clip_on=True
        )

    def show(self, frame: int) -> None:
        """Move the body to a frame."""
        if self._outline is not None:
            corners = self._body.outline[frame]
            self._outline.set_xy(corners)
            self._name.set_position(tuple(0.5 * (corners.min(axis=0) + corners.max(axis=0))))
        self._lines.set_data(*join_lines([line[frame] for line in self._body.lines]).T)
        self._faces.set_data(*join_lines([face[frame] for face in self._body.faces]).T)
        self._joints.set_data(*self._body.joints[frame].T)


class _Arrows:
    """The arrows of the contact forces."""

    def __init__(self, axes: "Axes", points: Array, arrows: Array) -> None:
        self._points = points
        self._arrows = np.where(arrows.any(axis=-1, keepdims=True), arrows, np.nan)  # NaN: not even a dot
        self._quiver = _quiver(axes, points[0], self._arrows[0])

    def show(self, frame: int) -> None:
        """Draw the forces of a frame."""
        self._quiver.set_offsets(self._points[frame])
        self._quiver.set_UVC(*self._arrows[frame].T)


def _clock(figure: "Figure", wide: float, end: float, unit: str) -> Any:
    """Draw a line from the start to the end of the run, and return the line on top of it that shows the time."""
    axes = figure.add_axes((0.1, 0.03, wide - 0.16, 0.02))
    axes.set_axis_off()
    axes.set(xlim=(0.0, end or 1.0), ylim=(-1.0, 1.0))
    axes.plot([0.0, end], [0.0, 0.0], color=GRID, linewidth=4, clip_on=False, solid_capstyle="butt")
    for x, side, text in ((-0.01, "right", f"0 {unit}"), (1.01, "left", f"{end:.4g} {unit}")):
        axes.text(x, 0.5, text, transform=axes.transAxes, ha=side, va="center", fontsize=8, color=MUTED)
    return axes.plot([], [], color=MUTED, linewidth=4, clip_on=False, solid_capstyle="butt")[0]


def _quiver(axes: "Axes", points: Array, arrows: Array) -> Any:
    """Draw arrows in the units of the axes."""
    style: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.004, "headwidth": 4, "clip_on": False}
    return axes.quiver(*points.T, *arrows.T, color=FORCE, zorder=5, **style)


def _explain_arrows(axes: "Axes", corner: Array, long: float, force: str) -> None:
    """Draw the key in a corner: an arrow of the length that represents ``force``."""
    _quiver(axes, corner[None], np.array([[long, 0.0]]))
    text = f" {force} (mean since the last frame); longer arrows than {CUT:g} of these are clipped"
    axes.text(corner[0] + long, corner[1], text, va="center", fontsize=8)


class _Inset:
    """The circle that limits a journal's axis, the axis's position, and its path."""

    def __init__(self, axes: "Axes", play: Play, unit: str) -> None:
        from matplotlib.patches import Circle

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


def common_force(forces: Array) -> float:
    """Return a round number (1, 2 or 5 times a power of ten) up to the 95th percentile of forces; 0 without forces."""
    sizes = np.linalg.norm(forces, axis=-1)
    if not (sizes > 0).any():
        return 0.0
    large = float(np.percentile(sizes[sizes > 0], COMMON))
    power = 10.0 ** np.floor(np.log10(large))
    return float(max(digit * power for digit in (1, 2, 5) if digit * power <= large * (1 + 1e-9)))


def arrow_lengths(forces: Array, common: float, long: float) -> Array:
    """Return the forces as arrows; the common force has length ``long``, and none is longer than ``CUT`` times that."""
    if not common:
        return np.zeros_like(forces)
    sizes = np.linalg.norm(forces, axis=-1, keepdims=True) / common
    return np.asarray(forces / common * long * np.minimum(1.0, CUT / np.maximum(sizes, CUT)))


def zigzag(a: Array, b: Array, teeth: int = 8) -> Array:
    """Return the polyline of a spring from a to b, shape (k, 2)."""
    span = b - a
    side = 0.06 * np.array([-span[1], span[0]])
    share = np.array([0.0, 0.15, *np.linspace(0.2, 0.8, teeth), 0.85, 1.0])
    swing = np.array([0.0, 0.0, *np.resize([1.0, -1.0], teeth), 0.0, 0.0])
    return np.asarray(a + share[:, None] * span + swing[:, None] * side)


def join_lines(lines: list[Array]) -> Array:
    """Return polylines, each of shape (k, 2), as one polyline with gaps."""
    gap = np.full((1, 2), np.nan)
    return np.vstack([gap, *(part for line in lines for part in (line, gap))])


def limits(box: Array, ends: Array) -> Array:
    """Return the corners, lower left and upper right, of a box around bodies and arrow ends, with a margin."""
    flat = np.vstack([box, ends.reshape(-1, 2)])
    corners = np.array([flat.min(axis=0), flat.max(axis=0)])
    margin = 0.06 * float(np.ptp(corners, axis=0).max() or 1.0)
    return np.asarray(corners + np.array([[-margin], [margin]]))


def _explain_insets(figure: "Figure", rings: int) -> None:
    """Write an explanation below the insets."""
    from matplotlib.lines import Line2D

    figure.text(0.65, 0.045, "axis of each journal in its bearing; circle: its clearance", fontsize=8)
    for i in range(rings if rings > 1 else 0):
        x = 0.66 + 0.09 * i
        mark, colour = MARKERS[i % len(MARKERS)], PALETTE[i % len(PALETTE)]
        figure.add_artist(Line2D([x], [0.02], marker=mark, color=colour, markersize=6, linestyle=""))
        figure.text(x + 0.012, 0.02, f"ring {i + 1}", fontsize=8, va="center")


def _grid(figure: "Figure", count: int) -> list["Axes"]:
    """Return axes for the circles of the joints, on the right of the figure."""
    columns = 1 if count <= 3 else 2 if count <= 8 else 3
    rows = max(-(-count // columns), 2)
    wide, high = 0.34 / columns, 0.84 / rows
    return [
        figure.add_axes((0.65 + wide * (i % columns), 0.93 - high * (i // columns + 1), 0.95 * wide, 0.82 * high))
        for i in range(count)
    ]
