"""Figures of the report as inline SVG.

The same bytes for the same numbers, text as text, a label for those who cannot see them. Drawn with
matplotlib's objects, never pyplot: no global figure list, no window system.
"""

import io
import re
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from reporting import numbers
from reporting.analysis import Analysis, ResponseAnalysis, VariableAnalysis
from reporting.histogram import Histogram

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, GRID = "#1d2733", "#5a6675", "#e3e7ec"
BAR, REJECT, LIMIT, TARGET = "#7fa6cc", "#c2371d", "#a61c00", "#1f6f43"
VERDICT_COLOURS = {"capable": "#1f6f43", "marginal": "#8a5a00", "not capable": "#a61c00"}
# The overview shows this much beyond the limits, in half distances between them.
_OVERVIEW_REACH = 2.0

_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "clearcap",
    "text.parse_math": False,  # a response may be called "F$1"
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "text.color": INK,
    "hatch.color": "white",
    "hatch.linewidth": 0.8,
}


def response_figure(response: ResponseAnalysis) -> str:
    """Return the histogram of a response with its limits in view and the normal curve, as an SVG element."""
    spec, c, bins = response.spec, response.capability, response.histogram

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        if bins is not None:
            _bars(axes, bins, spec.lsl, spec.usl)
        if c.mean is not None and c.std:
            x = np.linspace(c.mean - 4.5 * c.std, c.mean + 4.5 * c.std, 181)
            density = np.exp(-(((x - c.mean) / c.std) ** 2) / 2) / (c.std * np.sqrt(2 * np.pi))
            axes.plot(x, density, color=INK, linewidth=1.3)
        for value, name, colour, dash in (
            (spec.lsl, "LSL", LIMIT, "--"),
            (spec.usl, "USL", LIMIT, "--"),
            (spec.target, "target", TARGET, ":"),
        ):
            if value is not None:
                _marker(axes, value, f"{name} {numbers.plain(value)}", colour, dash)
        _finish(axes, spec.name, spec.unit)

    return _svg(draw, (7.4, 2.7), response_label(response), f"r-{spec.name}")


def response_label(response: ResponseAnalysis) -> str:
    """Return in words what the histogram of a response shows."""
    spec, c = response.spec, response.capability
    unit = unit_suffix(spec.unit)
    if c.n == 0:
        return f"Histogram of {spec.name}: no values."
    fences, places = (spec.lsl, spec.usl), numbers.decimals_for(c.std)
    low, high = numbers.fixed(c.min, places, fences), numbers.fixed(c.max, places, fences)
    text = f"Histogram of {spec.name}: {c.n} values from {low} to {high}{unit}"
    limits = [
        f"{name} {numbers.plain(value)}{unit}"
        for name, value in (("lower limit", spec.lsl), ("upper limit", spec.usl), ("target", spec.target))
        if value is not None
    ]
    rejects = (c.below or 0) + (c.above or 0)
    limits += [f"{rejects} values out of limits"] if c.ppm_observed is not None else ["no limits"]
    return f"{text}; {', '.join(limits)}."


def variable_figure(variable: VariableAnalysis) -> str:
    """Return the histogram of an input with the requested density, as an SVG element."""
    spec, bins = variable.spec, variable.histogram

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        if bins is not None:
            _bars(axes, bins, spec.lower, spec.upper)
        if spec.density:
            x, density = np.asarray(spec.density, dtype=float).T
            axes.plot(x, density, color=INK, linewidth=1.3)
        _finish(axes, spec.name, spec.unit)

    label = f"Histogram of input {spec.name}: {variable.n} values; requested {spec.distribution}."
    return _svg(draw, (3.5, 2.0), label, f"v-{spec.name}")


def overview_figure(analysis: Analysis) -> str | None:
    """Return where every response lies between its limits, scaled to -1 and +1; None without any."""
    shown = [r for r in analysis.responses if r.capability.cp is not None]
    if not shown:
        return None

    def draw(figure: "Figure") -> None:
        axes = figure.subplots()
        axes.axvspan(-1, 1, color="#eef3f8", linewidth=0)
        axes.axvline(0, color=GRID, linewidth=1)
        for row, response in enumerate(shown):
            _strip(axes, row, response)
        for limit, name in ((-1.0, "LSL"), (1.0, "USL")):
            _marker(axes, limit, name, LIMIT, "--")
        axes.set_yticks(range(len(shown)), [r.spec.name for r in shown], color=INK)
        axes.set_ylim(len(shown) - 0.4, -0.6)
        low, high = axes.get_xlim()
        axes.set_xlim(max(min(low, -1.15), -_OVERVIEW_REACH), min(max(high, 1.15), _OVERVIEW_REACH))
        axes.set_xlabel("position between the limits (0 = middle), each response in its own scale")
        axes.spines["left"].set_visible(False)
        axes.tick_params(length=0)

    said = "; ".join(f"{r.spec.name} {r.verdict}, Cpk {numbers.index(r.capability.cpk)}" for r in shown)
    label = f"Position and spread of every response between its limits: {said}."
    return _svg(draw, (7.4, 0.75 + 0.36 * len(shown)), label, "overview")


def unit_suffix(unit: str) -> str:
    """Return the unit with a space before it; nothing for a number without unit."""
    return "" if unit in ("", "1") else f" {unit}"


def _strip(axes: "Axes", row: int, response: ResponseAnalysis) -> None:
    """Draw one response of the overview: its range, plus and minus three sigma, its mean."""
    spec, c = response.spec, response.capability
    # A response with Cp has both limits and a spread.
    lsl, usl, mean, std = cast(tuple[float, ...], (spec.lsl, spec.usl, c.mean, c.std))
    low, high = cast(tuple[float, ...], (c.min, c.max))
    middle, half = (lsl + usl) / 2, (usl - lsl) / 2
    colour = VERDICT_COLOURS[response.verdict]

    def scaled(value: float) -> float:
        return (value - middle) / half

    axes.plot([scaled(low), scaled(high)], [row, row], color=colour, linewidth=1.2)
    ends = [scaled(mean - 3 * std), scaled(mean + 3 * std)]
    axes.plot(ends, [row, row], color=colour, linewidth=8, alpha=0.55, solid_capstyle="butt")
    axes.plot([scaled(mean)], [row], "o", color=colour, markersize=4.5)


def _bars(axes: "Axes", bins: Histogram, low: float | None, high: float | None) -> None:
    """Draw the bars as density; those outside the limits hatched, not only coloured."""
    edges, counts = np.asarray(bins.edges), np.asarray(bins.counts, dtype=float)
    widths = np.diff(edges)
    density = counts / (counts.sum() * widths)
    outside = np.zeros(counts.size, dtype=bool)
    # Inputs' bounds are no edges of their bins: only a bar that is outside as a whole is marked.
    if low is not None:
        outside |= edges[1:] <= low
    if high is not None:
        outside |= edges[:-1] > high
    line: dict[str, Any] = {"edgecolor": "white", "linewidth": 0.4, "align": "edge"}
    for rows, style in ((~outside, {"color": BAR}), (outside, {"color": REJECT, "hatch": "////"})):
        if rows.any():
            axes.bar(edges[:-1][rows], density[rows], widths[rows], **(line | style))


def _marker(axes: "Axes", value: float, text: str, colour: str, dash: str) -> None:
    """Draw a vertical line with its name above the axes."""
    axes.axvline(value, color=colour, linewidth=1.4, linestyle=dash)
    axes.annotate(
        text,
        (value, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
        color=colour,
        fontsize=8.5,
        fontweight="bold",
    )


def _finish(axes: "Axes", name: str, unit: str) -> None:
    """Label both axes with units and leave the bars standing on the ground."""
    bare = unit in ("", "1")
    axes.set_xlabel(name if bare else f"{name} [{unit}]")
    axes.set_ylabel("density" if bare else f"density [1/{unit}]" if " " not in unit else f"density [1/({unit})]")
    axes.margins(x=0.04)
    axes.set_ylim(bottom=0)
    axes.ticklabel_format(axis="x", useOffset=False)
    axes.locator_params(axis="y", nbins=4)
    axes.grid(axis="y", color=GRID, linewidth=0.7)
    axes.set_axisbelow(True)


def _svg(draw: "Callable[[Figure], None]", size: tuple[float, float], label: str, prefix: str) -> str:
    """Draw on a new figure and return it as an SVG element that can stand in a page among others."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE), warnings.catch_warnings():
        # Text stays text: the reader's browser has the glyphs that the measuring font lacks.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return _inline(buffer.getvalue(), label, prefix)


def _inline(document: str, label: str, prefix: str) -> str:
    """Return the svg element of a document: no prologue, metadata or style, ids of its own."""
    from markupsafe import escape

    svg = document[document.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>\s*|<style[^>]*>.*?</style>\s*|<!--.*?-->\s*", "", svg, flags=re.DOTALL)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', svg))
    tag = re.sub(r"[^A-Za-z0-9-]", lambda match: f"_{ord(match[0]):x}", prefix)
    svg = re.sub(r' id="([^"]+)"', lambda match: f' id="{tag}-{match[1]}"' if match[1] in used else "", svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{tag}-", svg)
    box = re.search(r'viewBox="[^"]+"', svg)
    assert box is not None
    start = f'<svg {box[0]} role="img" aria-label="{escape(label)}" xmlns:xlink="http://www.w3.org/1999/xlink">'
    return re.sub(r"^<svg[^>]*>", lambda _: start, svg).strip()
